/* The five steps of `gst place`. Each entry is saved at once, and read again when the page is loaded. */

"use strict";

const $ = (id) => document.getElementById(id);
const all = (selector) => [...document.querySelectorAll(selector)];
const STEPS = ["where", "how", "check", "run", "result"];

/** An element with properties and contents. */
function make(tag, properties, ...inside) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...inside);
  return made;
}

let state; // as the server has it: square, patches, answers …
let isStaged = null; // whether all places are from the stage; null until it is asked
let viewer = null; // of the stone, once it is there
let axes; // of the stone
let thickness; // of the stone along its shortest axis, mm
let clicks = []; // of corners
let marks = []; // drawn on the stone
const earlier = []; // for undo: square and patches as they were
let pointed = []; // patches that the check is about
let fits = {}; // a sentence on each patch, from the last search of their positions

// --- the server

async function ask(route, sent, digest = "") {
  const headers = { "Content-Type": "application/json", "Study-Digest": digest };
  const how = { method: "POST", headers };
  let answer;
  try {
    answer = await fetch(route, sent === undefined ? {} : { ...how, body: JSON.stringify(sent) });
  } catch {
    throw new Error("gst place has ended. Start it again to continue.");
  }
  const content = await answer.json();
  if (answer.ok) return content;
  if (answer.status === 409) refuse(content.error);
  throw new Error(content.error);
}

// A save was refused, because the files have changed. Until the page is reloaded, it shows the
// reason, and the user's unsaved work.
let isStale = false;
function refuse(text) {
  say(text, true);
  isStale = true;
  $("status").scrollIntoView({ block: "nearest" });
}

function say(text, isWrong = false) {
  if (isStale) return;
  $("status").textContent = text;
  $("status").className = isWrong ? "wrong" : "";
}

/** Show the error of some work, which the browser would not show. */
const guarded = (work) => work.catch((error) => say(error.message, true));

/** Lock the controls until some work is done. */
const locks = [];
async function locked(text, work) {
  locks.push(text);
  lock();
  try {
    return await work();
  } finally {
    locks.splice(locks.indexOf(text), 1);
    lock();
  }
}

/** While a check or a study reads the files, nothing is edited; one thing is done at a time. */
function lock() {
  const isRead = isRunning("check") || isRunning("study");
  const text = isRunning("check") ? "Checking …" : isRunning("study") ? "The study is running …" : locks.at(-1);
  $("busy").textContent = text || "";
  $("busy").hidden = !text;
  for (const id of ["where", "how"]) $(id).inert = isRead;
  for (const button of all("[data-start], #causes button")) button.disabled = Boolean(text);
  for (const button of all("[data-stop]")) button.disabled = !isRunning(button.dataset.stop);
}

let dragged = false; // since the pointer went down
let last = Promise.resolve();
let isUnsaved = false; // the last entry
/** Save one thing after the other, and tell whether it was saved. Each save names the files that the last one left. */
function save(route, sent) {
  const text = JSON.parse(JSON.stringify(sent)); // as it is now
  const origin = state;
  last = last.then(() => locked("Saving …", () => guarded(
    ask(route, text, origin.digest).then(({ digest, kept }) => {
      origin.digest = digest;
      if (reports.check) reports.check.changed = true;
      showSteps();
      say(kept ? `Saved. What was there is kept as ${kept}.` : "Saved.");
      return true;
    })))).then((isSaved) => {
    isUnsaved = !isSaved;
    return !isUnsaved;
  });
  return last;
}

// --- step 1: the square

const chosen = (name) => document.querySelector(`[name=${name}]:checked`).value;
const isPlacing = () => chosen("mode") !== "square"; // seen straight from above
const isPressing = () => chosen("mode") === "load";
const size = () => state.square.size_mm;
const side = () => state.patch_size_mm || 0.85;
const frame = () => state.square.points_mm && frameOf(state.square.points_mm);
const rounded = (points) => points.map((point) => point.map((value) => +value.toFixed(3)));

/** Keep the present state for undo, with the answers that a change will replace. */
function keep(replaced = []) {
  const { square, patches } = state;
  const answers = Object.fromEntries(replaced.map((key) => [key, state.answers[key]]));
  earlier.push(JSON.stringify({ square, patches, answers }));
}

let savedSize; // of the square; the face around it follows
function savePlaces() {
  draw();
  const now = size();
  return save("places", { square: state.square, patches: state.patches }).then((isSaved) => {
    if (isSaved && savedSize) state.face_mm *= now / savedSize;
    if (isSaved) savedSize = now;
    return isSaved;
  });
}

/** Lay the square about a point. */
function lay(point, normal, degrees) {
  state.square.points_mm = rounded(cornersAbout(point, normal, axes, size(), degrees));
}

/** Lay it about its own middle, with another side or turn. */
function layAgain(former, degrees = turnOf(former.frame, axes)) {
  lay(at(former.frame, former.side / 2, former.side / 2), former.frame.normal, degrees);
}

function picked(hit) {
  if (isPlacing()) return;
  if (!hit) return say("This click is beside the stone. Click the stone itself.", true);
  if (chosen("pick") === "middle") {
    keep();
    const normal = viewer.normal(hit.point, size() / 2) || hit.normal;
    lay(hit.point, normal, Number($("turn").value));
  } else {
    clicks.push(hit);
    if (clicks.length < 3) return draw();
    const three = clicks.map((click) => click.point);
    const corner = frameOf(three);
    const inward = corner && isInward(corner, clicks);
    clicks = [];
    draw();
    if (!corner) return say("The three corners are in line. Click them again.", true);
    keep();
    const [origin, first, second] = rounded(three);
    state.square.points_mm = inward ? [origin, second, first] : [origin, first, second];
  }
  savePlaces();
}

/** Lay the square in the middle of the view, half as wide as the view, upright in it.

    At most 0.3 times the stone's thickness: a face three times as wide is then on the stone, too. */
function propose() {
  const box = document.querySelector("canvas").getBoundingClientRect();
  const quarter = Math.min(box.width, box.height) / 4;
  const [x, y] = [box.left + box.width / 2, box.top + box.height / 2];
  const middle = viewer.pick();
  for (let half = quarter; middle && half > 4; half *= 0.9) {
    const hits = [[-half, half], [half, half], [-half, -half]].map(([a, b]) => viewer.pick(x + a, y + b));
    const seen = hits.every(Boolean) && frameOf(hits.map((hit) => hit.point));
    if (!seen) continue;
    keep();
    const across = Math.hypot(...add(hits[1].point, hits[0].point, -1));
    state.square.size_mm = +Math.min(across, 0.3 * thickness).toPrecision(2);
    lay(middle.point, viewer.normal(middle.point, size() / 2) || middle.normal, turnOf(seen, axes));
    return savePlaces();
  }
  return say("The middle of the view is beside the stone. Turn or move the stone, then propose again.", true);
}

function straighten() {
  if (!frame()) return;
  const middle = at(frame(), size() / 2, size() / 2);
  viewer.fit(middle, frame().normal, frame().y, span());
}

// --- step 1: the patches, seen straight from above; the plan has its y down, as SVG has

const MARGIN = 0.1;
const GRID = 4; // proposed positions along each side
const span = () => size() * (1 + 2 * MARGIN);
const svg = (name, attributes, ...inside) => {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...inside);
  return made;
};
const isGraded = (patch) => patch.wear_grade !== null;
const isSet = (patch) => patch.x_mm !== null && patch.y_mm !== null;
const turned = (degrees) => ((((degrees + 180) % 360) + 360) % 360) - 180;
const hasPictures = () => state.has_scans && !lacksUnit() && !lacks("mould.invert")
  && !state.asked.some(({ column }) => column === "t0");
// read once, until the page is loaded again or the mould is another
const opening = Date.now();
const pictureOf = (number) => `scan/${number}?${opening}-${
  ["invert", "flip"].map((key) => state.answers[`scans.mould.${key}`])}`;
const together = () => state.has_scans && $("together").checked;

function sticksOut({ x_mm: x, y_mm: y, rotation_deg: turn }) {
  const angle = (turn * Math.PI) / 180;
  const half = (side() / 2) * (Math.abs(Math.cos(angle)) + Math.abs(Math.sin(angle)));
  return [x, y].some((value) => value - half < -1e-9 || value + half > size() + 1e-9);
}

/** Move a patch, or with it all that are placed. */
function move(patch, dx, dy) {
  for (const each of together() ? state.patches.filter(isSet) : [patch]) {
    delete fits[each.patch];
    each.x_mm = +(each.x_mm + dx).toFixed(3);
    each.y_mm = +(each.y_mm + dy).toFixed(3);
  }
}

/** Turn a patch, or all that are placed about their middle. */
function rotate(patch, degrees) {
  const group = together() ? state.patches.filter(isSet) : [patch];
  const [x, y] = ["x_mm", "y_mm"].map(
    (key) => group.reduce((sum, each) => sum + each[key], 0) / group.length);
  const [cos, sin] = [Math.cos, Math.sin].map((ratio) => ratio((degrees * Math.PI) / 180));
  for (const each of group) {
    delete fits[each.patch];
    const [dx, dy] = [each.x_mm - x, each.y_mm - y];
    each.x_mm = +(x + dx * cos - dy * sin).toFixed(3);
    each.y_mm = +(y + dx * sin + dy * cos).toFixed(3);
    each.rotation_deg = +turned(each.rotation_deg + degrees).toFixed(3);
  }
}

/** Where on the square (x, y in mm) an event is. */
function placeOf(event) {
  const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(
    $("plan").getScreenCTM().inverse());
  return [at.x, size() - at.y];
}

/** Follow the pointer until it is let go; `moved` gets the way (mm) since the last call. */
function drag(event, moved) {
  event.preventDefault();
  event.stopPropagation();
  let before = placeOf(event);
  dragged = false;
  const follow = (next) => {
    const now = placeOf(next);
    if (!dragged) keep();
    dragged = true;
    moved(now[0] - before[0], now[1] - before[1], now, before);
    before = now;
    drawPlan();
  };
  const end = () => {
    removeEventListener("pointermove", follow);
    if (dragged) savePlaces();
  };
  addEventListener("pointermove", follow);
  addEventListener("pointerup", end, { once: true });
}

function drawPlan(focused) {
  $("plan").setAttribute("viewBox", [-MARGIN * size(), -MARGIN * size(), span(), span()].join(" "));
  const active = focused || document.activeElement?.dataset?.patch;
  $("plan").replaceChildren(svg("rect", { class: "edge", width: size(), height: size() }));
  $("plan").classList.toggle("pressing", isPressing());
  state.patches.forEach((patch, number) => isSet(patch) && drawOnPlan(patch, number));
  if (isPressing()) {
    const [x, y] = loadPoint();
    const arm = size() / 25;
    $("plan").append(svg("path", {
      class: "load", d: `M${x - arm} ${size() - y}h${2 * arm}M${x} ${size() - y - arm}v${2 * arm}` }));
  }
  if (active !== undefined)
    all("#plan .patch").find((each) => each.dataset.patch === active)?.focus({ preventScroll: true });
}

const loadPoint = () => state.answers["load.at_mm"] || [size() / 2, size() / 2];
function pressAt(x, y) {
  const reach = state.face_mm / 2;
  if ([x, y].every((value) => Math.abs(value - size() / 2) <= reach))
    return answer({ "load.at_mm": [x, y].map((value) => +value.toFixed(3)) });
  const [least, most] = [-reach, reach].map((value) => +(size() / 2 + value).toFixed(2));
  draw();
  return say(`The load point must be on the face. Give x and y between ${least} and ${most} mm.`, true);
}

function drawOnPlan(patch, number) {
  const half = side() / 2;
  const word = state.has_scans ? patch.patch : `${patch.patch}: ${patch.wear_grade ?? "?"}`;
  const box = { x: -half, y: -half, width: side(), height: side() };
  const handle = svg("circle", { class: "handle", cx: 0, cy: -half, r: size() / 70 });
  const made = svg("g", {
    class: `patch${sticksOut(patch) ? " out" : ""}${pointed.includes(patch.patch) ? " pointed" : ""}${
      state.has_scans || isGraded(patch) ? "" : " ungraded"}`,
    tabindex: 0,
    role: "button",
    "aria-label": `Patch ${word}`,
    transform: `translate(${patch.x_mm} ${size() - patch.y_mm}) rotate(${-patch.rotation_deg})`,
  });
  if (hasPictures())
    made.append(svg("image", { ...box, href: pictureOf(number), opacity: $("opacity").value }));
  made.append(svg("rect", box), svg("text", { "font-size": size() / 32 }, word));
  if (state.has_scans) made.append(handle);
  made.dataset.patch = patch.patch;
  made.onpointerdown = (event) => {
    made.focus({ preventScroll: true });
    drag(event, (dx, dy) => move(patch, dx, dy));
  };
  handle.onpointerdown = (event) => {
    const angle = ([x, y]) => (Math.atan2(y - patch.y_mm, x - patch.x_mm) * 180) / Math.PI;
    drag(event, (_dx, _dy, now, before) => rotate(patch, angle(now) - angle(before)));
  };
  made.onclick = (event) => event.stopPropagation();
  made.onkeydown = (event) => press(event, patch);
  $("plan").append(made);
}

function press(event, patch) {
  if (event.ctrlKey || event.metaKey || event.altKey) return; // the browser's own keys
  if (!state.has_scans && "0123".includes(event.key)) {
    if (event.repeat) return; // a key that is held down grades one position
    const isNew = !isGraded(patch);
    keep();
    patch.wear_grade = Number(event.key);
    savePlaces();
    const next = state.patches.find((each) => isSet(each) && !isGraded(each));
    if (isNew && next) drawPlan(next.patch); // so that one key after the other grades them all
    return;
  }
  const step = event.shiftKey ? 0.005 : 0.05;
  const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const turns = { "[": 1, "]": -1, "{": 0.1, "}": -0.1 };
  if (!(event.key in ways) && !(event.key in turns)) return;
  event.preventDefault();
  keep();
  if (event.key in ways) move(patch, ...ways[event.key].map((way) => way * step));
  else rotate(patch, turns[event.key]);
  savePlaces();
}

/** The rows beside the plan. */
function drawList() {
  const active = document.activeElement?.id;
  $("places").replaceChildren(...state.patches.map((patch, number) => {
    const picture = hasPictures() ? [thumbnail(patch, number)] : [];
    const rest = state.has_scans ? [numberOf(patch, "rotation_deg", "°"), fits[patch.patch] || ""]
      : [gradeOf(patch), removal(patch)];
    return make("li", {}, ...picture, make("b", {}, patch.patch),
      numberOf(patch, "x_mm", "x"), numberOf(patch, "y_mm", "y"), ...rest);
  }));
  if (active) $(active)?.focus({ preventScroll: true });
}

function thumbnail(patch, number) {
  return make("img", {
    src: pictureOf(number),
    alt: `Scan of ${patch.patch}`,
    draggable: false,
    onerror: () => guarded(ask(pictureOf(number))), // which shows the reason
    onpointerdown: (event) => drag(event, (_dx, _dy, [x, y]) => {
      const isOnPlan = [x, y].every((value) => Math.abs(value - size() / 2) <= span() / 2);
      if (isOnPlan) Object.assign(patch, { x_mm: +x.toFixed(3), y_mm: +y.toFixed(3) });
    }),
  });
}

function numberOf(patch, key, word) {
  const input = make("input", { type: "number", step: "any", id: `${key}-${patch.patch}` });
  input.value = patch[key] ?? "";
  input.ariaLabel = `${word === "°" ? "turn" : word} of ${patch.patch}`;
  input.onchange = () => {
    keep();
    patch[key] = input.value === "" ? (key === "rotation_deg" ? 0 : null) : Number(input.value);
    if (key === "rotation_deg") patch[key] = turned(patch[key]);
    savePlaces();
  };
  return make("label", {}, word, input);
}

function gradeOf(patch) {
  const grades = [...new Set([0, 1, 2, 3, patch.wear_grade ?? 0])].map((grade) => new Option(grade));
  const choice = make("select", { id: `grade-${patch.patch}` }, new Option("?", ""), ...grades);
  choice.value = patch.wear_grade ?? "";
  choice.ariaLabel = `How worn ${patch.patch} is`;
  choice.onchange = () => {
    keep();
    patch.wear_grade = choice.value === "" ? null : Number(choice.value);
    savePlaces();
  };
  return make("label", {}, "worn", choice);
}

function removal(patch) {
  const onclick = () => {
    keep();
    state.patches = state.patches.filter((each) => each !== patch);
    savePlaces();
  };
  return make("button", { type: "button", ariaLabel: `Remove ${patch.patch}`, onclick }, "✕");
}

/** Append an ungraded position, and return its name. */
function append(x, y) {
  const numbers = state.patches.map((patch) => Number(patch.patch) || 0);
  const name = String(Math.max(0, ...numbers) + 1);
  const at = { x_mm: +x.toFixed(3), y_mm: +y.toFixed(3) };
  state.patches.push({ patch: name, ...at, rotation_deg: 0, wear_grade: null });
  return name;
}

function addPlace(x, y) {
  if ([x, y].some((value) => value < 0 || value > size()))
    return say("This click is outside the square. Click inside it, or enlarge it first.", true);
  keep();
  const name = append(x, y);
  savePlaces();
  drawPlan(name); // chosen, so that a key grades it
}

/** Add positions at equal distances, row by row, where no position is near. */
function addGrid() {
  const step = size() / GRID;
  const middles = Array.from({ length: GRID }, (_, number) => (number + 0.5) * step);
  const free = middles.toReversed().flatMap((y) => middles.map((x) => [x, y])).filter(([x, y]) =>
    state.patches.every((each) => Math.hypot(each.x_mm - x, each.y_mm - y) >= step / 2));
  if (!free.length) return say("Positions are everywhere on the square. Grade them, or remove some first.", true);
  keep();
  const names = free.map((each) => append(...each));
  savePlaces();
  drawPlan(names[0]);
}

// --- step 1, drawn

/** How many places are graded, and how many are needed. */
function gradingHint() {
  const graded = state.patches.filter(isGraded);
  const left = state.patches.length - graded.length;
  const counts = `${count(graded.length, "graded position") || "No graded position"}; ${state.fewest} are needed.${
    left ? ` ${left} without a grade ${left > 1 ? "are" : "is"} left out.` : ""}`;
  if (!state.patches.length) return "Click each position whose wear you can grade, or add a grid. Then press 0 (unworn) to 3.";
  if (graded.length < state.fewest) return counts;
  return new Set(graded.map((patch) => patch.wear_grade)).size > 1 ? `${counts} Continue with step 2, How.`
    : `${counts} All have the same grade. Grade positions with more or less wear, too.`;
}

function hint() {
  if (!viewer) return "";
  const first = ["the reference corner, from which x and y run", "the end of x", "the end of y"];
  if (!isPlacing() && chosen("pick") === "corners") return `Click ${first[clicks.length]}.`;
  const isAll = state.patches.every(isSet);
  if (!frame())
    return `Turn the stone to the worn area and zoom in. Then click the middle of the square, or let it be proposed.${
      state.has_scans ? " If there is an overview map, press Find the exact positions instead." : ""}`;
  if (!isPlacing()) {
    const isOff = (corner) => !viewer.normal(corner, size() / 2);
    if (corners(frame(), size() / 2, size() / 2, size()).some(isOff))
      return "A corner of the square is beside the stone. Make the square smaller, or click elsewhere.";
    return isAll && state.patches.length
      ? "The square and all positions on it are set. A click would move the square away from them."
      : "The square is set. Turn it, or click elsewhere to move it.";
  }
  if (isPressing()) return "Click the point through which the force acted on average.";
  if (!state.has_scans) return gradingHint();
  const left = state.patches.filter((patch) => !isSet(patch)).length;
  if (left) return `Drag ${count(left, "more scan")} to the right position.`;
  const out = state.patches.filter(sticksOut).length;
  return out ? `${count(out, "scan")} beyond the edge of the square: move the scans, or enlarge the square.`
    : "All scans are placed. Continue with step 2, How.";
}

function draw() {
  for (const mark of marks) mark.remove();
  marks = [];
  const [laid, placing] = [frame(), isPlacing() && frame() !== null];
  if (viewer && laid) {
    marks.push(...drawSquare(viewer, laid, size()));
    for (const { patch, x_mm: x, y_mm: y, rotation_deg: turn } of placing ? [] : state.patches)
      if (x !== null && y !== null)
        marks.push(...drawPatch(viewer, laid, { name: patch, x, y, turn }, side()));
  }
  if (viewer) for (const { point } of clicks) marks.push(viewer.addLabel(point, "○"));
  $("size").value = size() ?? "";
  if (laid && axes) $("turn").value = turnOf(laid, axes);
  $("plan").toggleAttribute("hidden", !placing);
  $("of-square").hidden = placing;
  $("of-places").hidden = !placing || isPressing();
  $("of-load").hidden = !placing || !isPressing();
  if (size()) [$("load-x").value, $("load-y").value] = loadPoint();
  for (const id of ["together-asked", "of-all", "opacity-asked", "exact-asked"]) $(id).hidden = !state.has_scans;
  $("of-all").hidden ||= !$("together").checked;
  $("add-asked").hidden = state.has_scans;
  $("scan-keys").hidden = !state.has_scans;
  $("grade-keys").hidden = state.has_scans;
  $("undo").disabled = !earlier.length && !clicks.length;
  $("straight").disabled = !laid;
  $("whole").disabled = placing;
  for (const choice of all("[name=mode]")) choice.disabled = !laid && choice.value !== "square";
  $("hint").textContent = hint();
  if (placing) drawPlan();
  drawList();
}

/** Show the controls of the mode, or of another one. */
function setMode(mode) {
  if (mode) all("[name=mode]").find((choice) => choice.value === mode).checked = true;
  if (isPlacing()) straighten();
  const canvas = document.querySelector("canvas");
  if (canvas) canvas.tabIndex = isPlacing() ? -1 : 0; // else its keys would turn it away
  draw();
}

async function showStone() {
  $("unit-asked").hidden = !isToDo(state.answers["inputs.mesh_unit"]);
  if (viewer || !$("unit-asked").hidden) return;
  say("Reading the stone …");
  const stone = await ask("stone");
  axes = stone.axes;
  const places = new Float32Array(Uint8Array.from(atob(stone.vertices), (letter) => letter.charCodeAt(0)).buffer);
  const heights = Array.from({ length: places.length / 3 }, (_, k) =>
    dot(cross(...axes), places.subarray(3 * k, 3 * k + 3)));
  thickness = heights.reduce((a, b) => Math.max(a, b)) - heights.reduce((a, b) => Math.min(a, b));
  viewer = stoneViewer($("view"), stone, { label: `The stone ${state.mesh}`, lift: size() / 4 });
  if (!viewer) return;
  viewer.onclick = picked;
  $("painted-asked").hidden = !stone.colours;
  const plain = btoa("\xaa\xa3\x97".repeat(atob(stone.vertices).length / 12));
  $("painted").onchange = () => viewer.setColours($("painted").checked ? stone.colours : plain);
  if (stone.colours) $("painted").onchange();
  say("");
  if (frame() && state.patches.length && state.patches.every(isSet)) setMode("places");
  else {
    if (frame()) straighten();
    draw();
  }
}

$("size").onchange = () => {
  const value = Number($("size").value);
  if (!(value > 0 && value <= 100)) return say("The side must be more than 0 and at most 100 mm. Enter another side.", true);
  const [former, load] = [{ frame: frame(), side: size() }, state.answers["load.at_mm"]];
  keep(former.frame && load ? ["load.at_mm"] : []);
  state.square.size_mm = value;
  if (!former.frame) return savePlaces();
  layAgain(former);
  // the reference corner moves, and all that is on the stone stays there
  const moved = (mm) => +(mm + (value - former.side) / 2).toFixed(3);
  for (const patch of state.patches.filter(isSet))
    Object.assign(patch, { x_mm: moved(patch.x_mm), y_mm: moved(patch.y_mm) });
  return savePlaces().then((isSaved) => isSaved && load && answer({ "load.at_mm": load.map(moved) }));
};
let isTurning = false;
$("turn").oninput = () => {
  if (!frame()) return;
  if (!isTurning) keep();
  isTurning = true;
  const degrees = $("turn").value;
  layAgain({ frame: frame(), side: size() }, Number(degrees));
  draw();
  $("turn").value = degrees;
};
$("turn").onchange = () => {
  isTurning = false;
  if (frame()) savePlaces();
};
$("undo").onclick = () => {
  if (clicks.length) clicks.pop();
  else {
    const { answers, ...former } = JSON.parse(earlier.pop());
    Object.assign(state, former);
    fits = {};
    const saved = savePlaces();
    return Object.keys(answers).length ? saved.then((isSaved) => isSaved && answer(answers)) : saved;
  }
  return draw();
};
$("whole").onclick = () => viewer?.fit();
$("straight").onclick = straighten;
$("propose").onclick = () => viewer && propose();
$("opacity").oninput = () => drawPlan();
for (const id of ["azimuth", "altitude"])
  $(id).oninput = () => viewer?.rake(Number($("azimuth").value), Number($("altitude").value));
$("together").onchange = draw;
$("mirror").onclick = () => {
  keep();
  for (const patch of state.patches.filter(isSet))
    Object.assign(patch, { x_mm: +(size() - patch.x_mm).toFixed(3), rotation_deg: turned(-patch.rotation_deg) });
  savePlaces();
};
$("turn-all").onchange = () => {
  keep();
  rotate(null, Number($("turn-all").value));
  $("turn-all").value = 0;
  savePlaces();
};
$("exact").onclick = () => guarded(last.then(async () => {
  const match = await locked("Comparing heights: this takes up to a minute …", () => ask("find", {}));
  keep(Object.keys(match.answers));
  state.square = match.square;
  for (const place of match.places)
    Object.assign(state.patches.find(({ patch }) => patch === place.patch), place);
  fits = match.fits;
  if (!await savePlaces()) return;
  if (match.places.length) await answer(match.answers);
  say(match.all, !match.places.length);
  if (match.places.length) setMode("places"); // whose list shows how well each fits
}));
$("add").onclick = () => addPlace(size() / 2, size() / 2);
$("grid").onclick = addGrid;
$("plan").onpointerdown = () => { dragged = false; };
$("plan").onclick = (event) => {
  if (isPressing()) pressAt(...placeOf(event));
  else if (!state.has_scans && !dragged) addPlace(...placeOf(event));
};
for (const id of ["load-x", "load-y"])
  $(id).onchange = () => pressAt($("load-x").valueAsNumber, $("load-y").valueAsNumber);
$("load-middle").onclick = () => answer({ "load.at_mm": null });
for (const choice of all("[name=mode]")) choice.onchange = () => setMode();
for (const choice of all("[name=pick]")) choice.onchange = () => { clicks = []; draw(); };

// --- step 2: each choice is the values that it writes

// the mesh may have shown how a scan is flipped
const isAnswer = (values) => Object.entries(values).every(
  ([key, value]) => key === "scans.mould.flip" || state.answers[key] === value);
const valuesOf = (choice) => JSON.parse(choice.dataset.values);
const isToDo = (value) => typeof value === "string" && value.startsWith("TODO");
/** Whether one of these keys of the scans is still missing: without it, they cannot be shown. */
const lacks = (...keys) => keys.some((key) => isToDo(state.answers[`scans.${key}`]));
const lacksUnit = () => lacks("unit", "spacing_um", "size_mm");
$("rock-2").innerHTML = $("rock").innerHTML;

function showAnswers() {
  for (const name of new Set(all("#how [type=radio]").map((choice) => choice.name))) {
    const group = all(`[name=${name}]`);
    const chosenOne = group.find((choice) => choice.dataset.values && isAnswer(valuesOf(choice)));
    const own = group.find((one) => "own" in one.dataset);
    const isOwn = own && isGiven(own.closest("fieldset").querySelector(".own input").dataset.key);
    for (const choice of group) choice.checked = choice === (chosenOne || (isOwn ? own : null));
  }
  for (const input of all("[data-key]")) {
    if (input === document.activeElement) continue; // what is being typed there stays
    const value = state.answers[input.dataset.key];
    const isNumber = typeof value === "number";
    if (isNumber) input.value = +(value * (input.dataset.scale || 1)).toPrecision(6);
    else input.value = isToDo(value) ? "" : value ?? "";
    if (isToDo(value)) input.placeholder = value.slice(4).trim(); // what is likely
  }
  for (const choice of all("[data-stone]")) {
    const n = choice.dataset.stone;
    if (!isGiven(`material.young_${n}_MPa`)) choice.value = "?";
    if (!isGiven(`material.young_${n}_MPa`)) continue;
    const value = `${state.answers[`material.young_${n}_MPa`] / 1000} ${state.answers[`material.poisson_${n}`]}`;
    choice.value = [...choice.options].some((option) => option.value === value) ? value : "";
  }
  $("mould").hidden = !state.has_scans;
  $("scan-unit").hidden = !lacksUnit();
  // asked at the first step where there are no pictures without an answer
  if (lacks("mould.invert")) $("asked-first").append($("mould"));
  if (lacksUnit()) $("asked-first").append($("scan-unit"));
  questions().forEach((isAnswered, k) =>
    $(["hard", "against", "rocks", "mould"][k]).classList.toggle("open", !isAnswered));
  const modulus = state.answers["material.contact_modulus_MPa"];
  $("own-modulus").hidden = modulus === null;
  $("own-modulus").firstElementChild.textContent =
    `The config contains contact_modulus_MPa, ${modulus} MPa, which replaces these constants.`;
  for (const choice of all("#against input")) choice.disabled = state.own_tool;
  if (state.own_tool) $("own-tool").textContent = "The config contains the mesh and pose of the active tool, which are used.";
}

/** Which scan a patch has at an epoch, if neither names nor heights show it. */
function showFiles() {
  $("files").hidden = !state.asked.length;
  const words = { t0: "before use", t1: "after use", repeat: "again, without use" };
  $("as-likely").hidden = !state.asked.some(({ likely }) => likely);
  $("files").querySelector("div").replaceChildren(...state.asked.map(({ patch, column, likely }) => {
    const none = column === "t0" ? [] : [new Option("none", "")];
    const names = state.files.map((name) => new Option(name));
    const choice = make("select", {}, new Option("…", "…"), ...none, ...names);
    choice.onchange = async () => {
      await save("file", { patch, column, name: choice.value });
      await load();
    };
    return make("label", {}, `${patch} ${words[column]} `, choice, likely && ` suggestion: ${likely}`);
  }));
}

$("as-likely").onclick = async () => {
  for (const { patch, column, likely } of state.asked.filter((each) => each.likely))
    await save("file", { patch, column, name: likely });
  await load();
};

$("own-modulus").lastElementChild.onclick = () => answer({ "material.contact_modulus_MPa": null });

const answer = (values) => locked("Saving …", () => save("answers", values).then(load));

for (const choice of all("#how [type=radio]")) {
  choice.onchange = () => {
    if (choice.dataset.values) answer(valuesOf(choice));
    else choice.closest("fieldset").querySelector(".own input").focus();
  };
}
for (const input of all("[data-key]")) {
  input.onchange = () => {
    if (input.value === "") return;
    const value = input.type === "number" ? Number(input.value) / (input.dataset.scale || 1) : input.value;
    answer({ [input.dataset.key]: value });
  };
}
for (const choice of all("[data-stone]")) {
  choice.onchange = () => {
    const [young, poisson] = choice.value.split(" ").map(Number);
    const n = choice.dataset.stone;
    if (poisson) answer({ [`material.young_${n}_MPa`]: young * 1000, [`material.poisson_${n}`]: poisson });
  };
}
document.querySelector("form").onsubmit = (event) => event.preventDefault();

// --- steps 3 and 4: commands and their reports

const SECTIONS = { check: "check", study: "run" };
const reports = {}; // by command, from the server
const shown = {};
const handled = new Set(); // numbers of causes, since the check
const isRunning = (name) => Boolean(reports[name]?.running);
const count = (number, word) => (number ? `${number} ${word}${number > 1 ? "s" : ""}` : "");
const countCauses = (level) => (reports.check?.causes || []).filter((cause) => cause.level === level).length;
const warnings = () => [count(countCauses("accepted"), "accepted fault"), count(countCauses("warning"), "warning")]
  .filter(Boolean).join(" · ");

function howItIs(name, { running, code, changed, causes }) {
  if (running) return "Running …";
  if (changed) return "Your entries have changed since then. Repeat this step.";
  if (causes) return countCauses("error") ? `The study cannot run yet: ${count(countCauses("error"), "fault")}.`
    : `The study can run. ${warnings()}`;
  if (code === null) return ""; // of another server
  if (code === 0) return "Done. Continue with step 5, Result.";
  if (code < 0) return "Stopped.";
  return "It ended early. The messages below give the reason.";
}

function showReport(name) {
  const section = $(SECTIONS[name]);
  const text = JSON.stringify([reports[name], state.answers.accept, [...handled]]);
  lock();
  if (shown[name] === text) return;
  shown[name] = text;
  section.querySelector("[role=status]").textContent = howItIs(name, reports[name]);
  const box = section.querySelector(".messages");
  box.replaceChildren(...reports[name].records.map(
    ({ level, text: line }) => make("p", { className: level }, line)));
  if (name === "study") showProgress(reports.study, box);
  else showCauses(reports.check);
}

// --- step 3: each cause once, with its remedies

const MARKS = { error: "✖ ", accepted: "✔ ", warning: "▲ ", note: "" };

function showCauses({ causes, summary, running }) {
  const accepted = (state.answers.accept || []).map((name) => make("li", { className: "accepted" },
    make("span", {}, `✔ ${name} is accepted in the config.`),
    does("Take back", () => answer({ accept: state.answers.accept.filter((each) => each !== name) }))));
  $("causes").replaceChildren(...(running ? [] : [...(causes || []).map(lineOf), ...accepted]));
  $("summary").hidden = running || !summary;
  $("summary").lastElementChild.textContent = summary || "";
  if (!running && summary?.includes("check.png")) showPicture();
  lock();
}

const does = (text, work) => make("button", { type: "button", onclick: () => guarded((async () => work())()) }, text);

/** Remove a cause, whose line then shows it. */
async function handle(number, route, sent) {
  await locked("Saving …", async () => {
    if (!await save(route, sent)) return;
    handled.add(number);
    if (route === "cure") earlier.length = 0; // undo would take back its cells alone
    await load();
  });
}

function lineOf(cause, number) {
  const { level, text, more, accept, cure } = cause;
  if (handled.has(number)) return make("li", {}, make("span", {}, `✓ Done. Check again to confirm it: ${text}`));
  const [, line, meaning] = text.match(/^(.*?)(?: \[(.*)\]\.?)?$/s);
  const further = meaning ? [meaning, ...more] : [...more];
  if (cure) further.push(`${cure.button} writes ${JSON.stringify({ ...cure.values, ...cure.cells })}.`);
  const [patches, step] = [namedIn(cause), level === "error" && stepOf(text)];
  return make("li", { className: level }, make("span", {}, MARKS[level], line),
    cure ? does(cure.button, () => handle(number, "cure", number)) : "",
    level === "error" && accept.length ? does("Accept", () => handle(number, "answers",
      { accept: [...new Set([...(state.answers.accept || []), ...accept])] })) : "",
    patches.length ? does("Show", () => point(patches)) : step ? does("Show", () => go(step)) : "",
    further.length ? make("details", {},
      make("summary", {}, more.length ? `${more.length} more` : cure ? "Values that the button writes" : "Explanation"),
      ...further.map((each) => make("p", {}, each))) : "");
}

/** The patches that a cause is about. */
function namedIn({ text, more }) {
  const lists = [text, ...more].join("\n").matchAll(/patch(?:es)? ((?:[A-Za-z0-9-]+(?:, | and )?)+)/g);
  const names = [...lists].flatMap(([, list]) => list.split(/, | and /));
  return state.patches.filter((patch) => isSet(patch) && names.includes(patch.patch));
}

/** The step where a value is given. */
function stepOf(text) {
  if (/square\.points_mm|x_mm|y_mm|grade|mesh_unit/.test(text)) return "where";
  return /'?(load|counterface|material|scans)\./.test(text) ? "how" : null;
}

/** Show patches at their places. */
function point(patches) {
  pointed = patches.map(({ patch }) => patch);
  go("where");
  setMode("places");
  drawPlan(pointed[0]);
}

function showPicture() {
  const place = `results/check.png?${Date.now()}`; // it is another after each check
  $("check-picture").onload = () => { $("check-link").hidden = false; };
  $("check-picture").src = $("check-link").href = place;
}

/** The steps done of all, and the time since the start, from the messages of the study. */
function showProgress({ running, records }, box) {
  const text = records.map((record) => record.text).join("\n"); // the step may be hidden
  const [, done, whole] = [...text.matchAll(/(\d+) of (\d+) steps done/g)].at(-1) || [];
  const [, passed] = [...text.matchAll(/^(\d+:\d\d:\d\d) /gm)].at(-1) || [];
  $("progress").hidden = !done;
  if (!done) return;
  $("progress").value = done / whole;
  if (running) $("run").querySelector("[role=status]").textContent =
    `${done} of ${whole} steps done ${passed} after the start.`;
  box.scrollTop = box.scrollHeight;
}

const timers = {};
async function follow(name) {
  const wasRunning = isRunning(name);
  reports[name] = await ask(`report/${name}`);
  showReport(name);
  clearTimeout(timers[name]);
  if (isRunning(name)) timers[name] = setTimeout(() => guarded(follow(name)), 1000);
  else if (wasRunning) {
    if (name === "study") $("answer").removeAttribute("src");
    await showResult();
    if (name === "study" && now === "run" && howFar().result.done) go("result");
  }
  showSteps();
}

const start = (name) => guarded(locked("Starting …", async () => {
  await last;
  handled.clear();
  await ask(`start/${name}`, {});
  await follow(name);
}));
for (const button of all("[data-start]")) button.onclick = () => start(button.dataset.start);
for (const button of all("[data-stop]"))
  button.onclick = () => guarded(ask(`stop/${button.dataset.stop}`, {}));

// --- step 5

let result = {};
async function showResult() {
  result = await ask("result");
  const { page, problem } = result;
  $("own-page").hidden = page === null;
  if (page) $("open").href = page;
  $("answer").hidden = page === null;
  // read when it is first looked at, and again after each run
  if (page && now === "result" && !$("answer").src) $("answer").src = page;
  $("no-result").textContent = problem ? `${page ? "Run the study again: " : ""}${problem}.` : "";
}

// --- the steps, how far each is, and the next one

const isGiven = (key) => !isToDo(state.answers[key]);

/** The questions of step 2, and whether each is answered. */
function questions() {
  const rocks = ["young_1_MPa", "poisson_1", "young_2_MPa", "poisson_2"].map((key) => `material.${key}`);
  return [
    isGiven("load.force_N"),
    state.own_tool || isGiven("counterface.radius_mm"),
    state.answers["material.contact_modulus_MPa"] !== null || rocks.every(isGiven),
    ...(state.has_scans ? [!lacks("mould.invert", "unit", "spacing_um", "size_mm")] : []),
  ];
}

/** How each step is: done, wrong, or neither; and in a word or two. */
function howFar() {
  const [{ patches, has_scans, asked }, how] = [state, questions()];
  const placed = patches.filter(has_scans ? isSet : isGraded).length;
  const isEnough = has_scans ? placed === patches.length : !patches.length || (placed >= state.fewest
    && new Set(patches.filter(isGraded).map((patch) => patch.wear_grade)).size > 1);
  const answered = how.filter(Boolean).length;
  const causes = !isRunning("check") && !reports.check?.changed && reports.check?.causes;
  const faults = causes ? countCauses("error") : 0;
  const { page, problem } = result;
  const isWhole = Boolean(page && !problem);
  return {
    where: { done: Boolean(frame()) && isEnough && !asked.length && isGiven("inputs.mesh_unit"),
      text: patches.length ? `${placed} of ${patches.length}` : frame() ? "" : "no square" },
    how: { done: answered === how.length, text: `${answered} of ${how.length}` },
    check: { done: Boolean(causes) && !faults, wrong: faults,
      text: isRunning("check") ? "…" : faults ? count(faults, "fault") : causes ? warnings() : "" },
    run: { done: isWhole && !isRunning("study"), wrong: !isWhole && !isRunning("study") && reports.study?.code > 0,
      text: isRunning("study") ? `${Math.round(100 * $("progress").value)} %` : "" },
    result: { done: isWhole, text: page && problem ? "outdated" : "" },
  };
}

function showSteps() {
  if (!state) return;
  const steps = howFar();
  const next = STEPS.find((step) => !steps[step].done);
  for (const link of all("nav a")) {
    const step = link.hash.slice(1);
    const { done, wrong, text } = steps[step];
    link.querySelector(".state").textContent = wrong ? "✖" : done ? "✓" : step === next ? "●" : "○";
    link.querySelector("small").textContent = text;
    link.className = wrong ? "wrong" : done ? "done" : "";
    link.title = wrong ? "This step has a fault" : done ? "Done" : "To do";
  }
  const behind = STEPS[STEPS.indexOf(now) + 1];
  $("next").hidden = !behind;
  $("next").className = steps[now].done ? "ready" : "";
  if (behind) $("next").textContent = `Next: ${behind[0].toUpperCase()}${behind.slice(1)} ▸`;
  $("next").onclick = () => {
    go(behind);
    const isReady = steps.where.done && steps.how.done;
    if (behind === "check" && isReady && !steps.check.done && !isRunning("check")) start("check");
  };
}

const go = (step) => { location.hash = step; };
let now; // the step that is shown

function show() {
  const step = STEPS.includes(location.hash.slice(1)) ? location.hash.slice(1)
    : frame() && state.patches.every(isSet) && !state.asked.length ? "how" : "where";
  now = step;
  for (const each of STEPS) $(each).hidden = each !== step;
  for (const link of all("nav a")) {
    if (link.hash === `#${step}`) link.setAttribute("aria-current", "step");
    else link.removeAttribute("aria-current");
  }
  if (step === "how") document.querySelector("form").append($("mould"), $("scan-unit"));
  if (step === "check") guarded(follow("check"));
  if (step === "run") guarded(follow("study"));
  if (step === "result") guarded(showResult());
  showSteps();
}

async function load() {
  let before, fresh;
  do { // until nothing was answered meanwhile, which would be shown as it was before
    before = last;
    await before;
    fresh = await ask("state");
  } while (before !== last);
  if (isStale) return; // what is shown is the user's unsaved work
  // undo would revert changes of another page
  if (state && state.digest !== fresh.digest) earlier.length = 0;
  state = fresh;
  savedSize = size();
  $("title").textContent = document.title = state.title;
  $("things").textContent = state.has_scans ? "Place the scans" : "Grade positions";
  $("legend").textContent = state.has_scans ? "Scans" : "Positions and their grades";
  showAnswers();
  showFiles();
  draw();
  if (!document.querySelector("nav [aria-current]")) show(); // the stone may take its time
  await Promise.all([follow("check"), follow("study"), showResult()]);
  await showStone();
  if (isStaged !== null || !hasPictures()) return;
  isStaged = (await ask("stage")).all;
  $("together").checked = isStaged;
  draw();
}

$("end").onclick = () => guarded(last.then(() => ask("end", {})).then(() => say(isUnsaved
  ? "gst place has ended. Your last entry was not saved: note it before you close this page."
  : "gst place has ended, and everything is saved. You may close this page.", isUnsaved)));
addEventListener("hashchange", () => { say(""); show(); });
guarded(load());
