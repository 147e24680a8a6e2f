"use strict";

// --- cards of the patches: any link to a card opens it

document.documentElement.classList.add("scripted");

function openCard(name) {
  const card = name.startsWith("#patch-") && document.getElementById(decodeURI(name.slice(1)));
  for (const other of card ? document.querySelectorAll("dialog.card[open]") : []) if (other !== card) other.close();
  if (card && !card.open) card.showModal();
  if (card) history.replaceState(null, "", name); // the address of the card, to be passed on
  return Boolean(card);
}

for (const card of document.querySelectorAll("dialog.card"))
  card.addEventListener("close", () => {
    if (!document.querySelector("dialog.card[open]")) history.replaceState(null, "", location.pathname + location.search);
  });
window.addEventListener("hashchange", () => openCard(location.hash));

document.addEventListener("click", (event) => {
  const link = event.target.closest("a[href^='#patch-']");
  if (link && openCard(link.getAttribute("href"))) event.preventDefault();
  const close = event.target.closest("dialog form button");
  if (close) {
    event.preventDefault(); // a form is dead in the sandbox of `gst place`
    close.closest("dialog").close();
  }
  const blink = event.target.closest(".blink");
  if (blink) compare(blink.dataset.patch);
  const picture = event.target.closest(".enlarge");
  if (picture) {
    const large = document.querySelector("#large img");
    const small = picture.querySelector("img");
    [large.src, large.alt] = [small.src, small.alt];
    document.getElementById("large").showModal();
  }
  if (event.target instanceof HTMLDialogElement) event.target.close(); // beside it
});
openCard(location.hash);

// --- Save: files are made from the page itself, so that a copy without its folder has them, too

const json = (id) => JSON.parse(document.getElementById(id).textContent);
const bytesOf = (base64) => Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
const textBytes = (text) => new TextEncoder().encode(text);
const METHODS = "methods.txt";

function csvOf(table) {
  const quoted = (text) => (/[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  return [...table.rows].map((row) => [...row.cells].map((one) => quoted(one.textContent)).join(",") + "\n").join("");
}

// Each file by its name in the folder of the results, with a function that makes its bytes.
function files() {
  const all = { [METHODS]: () => textBytes(document.getElementById("methods-text").textContent) };
  for (const [name, curve] of Object.entries(json("curves"))) all[name] = () => textBytes(curve);
  for (const one of document.querySelectorAll("[data-file]"))
    all[one.dataset.file] = () => (one.matches("img") ? bytesOf(one.src.split(",")[1]) : textBytes(csvOf(one)));
  return all;
}

const CRC = Uint32Array.from({ length: 256 }, (_, n) => {
  for (let bit = 0; bit < 8; bit++) n = n & 1 ? (n >>> 1) ^ 0xedb88320 : n >>> 1;
  return n;
});

// A zip without compression and without times: the same page gives the same bytes.
function zipped(all) {
  const numbers = (...pairs) => Uint8Array.from(
    pairs.flatMap(([value, size]) => Array.from({ length: size }, (_, k) => (value >>> (8 * k)) & 255)));
  const [parts, listed] = [[], []];
  let [at, length] = [0, 0];
  for (const name of Object.keys(all).sort()) {
    const [title, content] = [textBytes(name), all[name]()];
    const crc = ~content.reduce((sum, byte) => CRC[(sum ^ byte) & 255] ^ (sum >>> 8), -1);
    const size = content.length;
    // version 2.0, names in UTF-8, stored, midnight of 1980-01-01
    const about = [[20, 2], [0x800, 2], [0, 4], [0x21, 2], [crc, 4], [size, 4], [size, 4], [title.length, 2], [0, 2]];
    parts.push(numbers([0x04034b50, 4], ...about), title, content);
    listed.push(numbers([0x02014b50, 4], [20, 2], ...about, [0, 10], [at, 4]), title);
    at += 30 + title.length + size;
    length += 46 + title.length;
  }
  const count = listed.length / 2;
  const end = numbers([0x06054b50, 4], [0, 4], [count, 2], [count, 2], [length, 4], [at, 4], [0, 2]);
  return new Blob([...parts, ...listed, end]);
}

function save(name, content) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content]));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

function saveAll(folder) {
  const all = files();
  if (folder === METHODS) return save(METHODS, all[METHODS]());
  for (const name of Object.keys(all)) if (!name.startsWith(folder)) delete all[name];
  const title = document.querySelector("h1").dataset.title.toLowerCase().replace(/[^\p{L}\p{N}]+/gu, "-");
  save(`${[title, folder.slice(0, -1)].filter(Boolean).join("-")}.zip`, zipped(all));
}

document.addEventListener("click", (event) => {
  const menu = document.getElementById("save");
  const chosen = event.target.closest("[data-save]");
  if (chosen) saveAll(chosen.dataset.save);
  if (chosen || !menu.contains(event.target)) menu.open = false;
  const link = event.target.closest("a[download]");
  const name = link?.getAttribute("href");
  const make = name && files()[name];
  if (make) {
    event.preventDefault();
    save(name.split("/").pop(), make());
  }
});
document.getElementById("save").addEventListener("keydown", (event) => {
  if (event.key !== "Escape") return;
  event.currentTarget.open = false;
  event.currentTarget.firstElementChild.focus();
});
document.getElementById("show-methods").addEventListener("click", () => document.getElementById("methods").showModal());
document.getElementById("copy-methods").addEventListener("click", async () => {
  const text = document.getElementById("methods-text");
  getSelection().selectAllChildren(text); // remains selected if the browser forbids to copy
  const isCopied = document.execCommand("copy") || await navigator.clipboard?.writeText(text.textContent).then(() => true, () => false);
  document.getElementById("copied").textContent = isCopied ? "Copied." : "The text is selected: press Ctrl+C to copy it.";
});

// --- T0 and T1 of a patch in turn

const EPOCHS = ["T0, before use", "T1, after use"];

function showEpoch(number) {
  document.getElementById("blink-picture").style.backgroundPositionX = `${50 * number}%`; // of three
  document.getElementById("blink-picture").ariaLabel = EPOCHS[number];
  document.getElementById("blink-now").textContent = EPOCHS[number];
  document.getElementById("blink-now").dataset.epoch = number;
}

function compare(patch) {
  const strip = document.querySelector(`.thumbnails a[href='#patch-${patch}'] img`);
  document.getElementById("blink-picture").style.backgroundImage = `url(${strip.src})`;
  document.getElementById("blink-title").textContent = `Patch ${patch}`;
  showEpoch(0);
  document.getElementById("blink").showModal();
}

const nextEpoch = () => showEpoch(1 - document.getElementById("blink-now").dataset.epoch);
document.getElementById("blink-now").addEventListener("click", nextEpoch);
setInterval(() => {
  if (document.getElementById("blink").open && document.getElementById("blink-on").checked) nextEpoch();
}, 700);

// --- the table of the patches sorts by the column whose heading is clicked

const table = document.getElementById("patch-table");
table.tHead.addEventListener("click", (event) => {
  const button = event.target.closest("button");
  if (!button) return;
  const heading = button.parentElement;
  const isNumber = button.dataset.kind === "number";
  // The largest numbers first, and names from the start.
  const first = isNumber ? "descending" : "ascending";
  const second = isNumber ? "ascending" : "descending";
  const order = heading.ariaSort === first ? second : first;
  for (const other of heading.parentElement.cells) other.ariaSort = "none";
  heading.ariaSort = order;
  const sign = order === "ascending" ? 1 : -1;
  const value = (row) => row.cells[heading.cellIndex].dataset.value;
  const compare = (a, b) => {
    if (a === "" || b === "") return (a === "") - (b === ""); // the unknown last
    return sign * (isNumber ? a - b : a.localeCompare(b, "en", { numeric: true }));
  };
  const rows = [...table.tBodies[0].rows].sort((a, b) => compare(value(a), value(b)));
  table.tBodies[0].append(...rows);
});

// --- what a load elsewhere would have done, from the nearest draws of the inferred use

const NEAREST = 50; // draws whose mean is shown

function explore(draws) {
  const { x_mm: xs, y_mm: ys, weight: weights } = draws;
  const fields = [draws.pressure, draws.loss].filter(Boolean);
  const form = document.getElementById("explorer");
  const map = document.getElementById("map");
  const { patches, measured, near_mm: near } = draws;
  const [low, high] = form.dataset.face.split(" ").map(Number);
  const short = (value) => (Math.abs(value) < 0.005 ? "0" : String(Number(value.toPrecision(3))).replace("-", "−"));
  const total = weights.reduce((sum, weight) => sum + weight, 0);

  const say = (text, isKnown) => {
    document.getElementById("asked-how").textContent = text;
    document.getElementById("asked").hidden = !isKnown;
  };

  function show(x, y) {
    const place = `x ${short(x)}, y ${short(y)} mm`;
    if (![x, y].every((value) => low <= value && value <= high)) {
      document.getElementById("asked-at").setAttribute("display", "none");
      return say(`${place} lies outside the face, which covers x and y from ${short(low)} to ${short(high)} mm.`);
    }
    for (const [name, value] of Object.entries({ cx: x, cy: -y, display: "inline" }))
      document.getElementById("asked-at").setAttribute(name, value);
    const away = xs.map((draw, k) => Math.hypot(draw - x, ys[k] - y));
    const nearest = [...away.keys()].filter((k) => weights[k] > 0).sort((a, b) => away[a] - away[b]).slice(0, NEAREST);
    const [first, last] = [away[nearest[0]], away[nearest.at(-1)]].map(short);
    if (away[nearest[0]] > near)
      return say(`No draw of the load point lies within ${short(near)} mm of ${place}: the nearest one is ${first} mm away.`);
    const sum = nearest.reduce((all, k) => all + weights[k], 0);
    const mean = (field, patch) =>
      nearest.reduce((all, k) => all + weights[k] * field[k][patch], 0) / sum;
    const within = weights.reduce((all, weight, k) => all + (away[k] <= near ? weight : 0), 0) / total;
    const rows = patches.map((patch, number) => {
      const row = document.createElement("tr");
      for (const text of [patch, ...fields.map((field) => short(mean(field, number))), short(measured[number])])
        row.insertCell().textContent = text;
      return row;
    });
    form.querySelector("tbody").replaceChildren(...rows);
    say(`The load acts at ${place}. ${short(100 * within)} % of the draws of the load point, by weight, lie within ${short(near)} mm of it. The values below are means over the ${nearest.length} nearest draws, which are ${first} to ${last} mm away.`, true);
  }

  const ask = () => show(form.elements.x.valueAsNumber, form.elements.y.valueAsNumber);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("keydown", (event) => { if (event.key === "Enter") ask(); });
  form.querySelector("button").addEventListener("click", ask);
  map.addEventListener("click", (event) => {
    if (event.target.closest("a")) return;
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(map.getScreenCTM().inverse());
    [form.elements.x.value, form.elements.y.value] = [at.x.toFixed(2), (-at.y).toFixed(2)];
    ask();
  });
}

const stored = json("draws");
if (stored) explore(stored);

// --- the tool

function showTool(scene) {
  const element = document.getElementById("viewer");
  element.replaceChildren();
  const viewer = stoneViewer(element, scene.stone, { label: "The tool in 3D" });
  const show = (chosen) => {
    const parts = (of) => document.querySelectorAll(of);
    parts("#map image").forEach((map, k) => map.setAttribute("display", k === chosen ? "inline" : "none"));
    parts(".scale.field").forEach((scale, k) => { scale.hidden = k !== chosen; });
    if (viewer) viewer.setColours(scene.fields[chosen].colours);
  };
  for (const choice of document.querySelectorAll("input[name=field]"))
    choice.addEventListener("change", () => show(Number(choice.value)));
  show(0);
  if (!viewer) return;
  const { origin, axes, size } = scene.frame;
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const mean = (points) =>
    [0, 1, 2].map((k) => points.reduce((sum, point) => sum + point[k], 0) / points.length);
  viewer.addOutline(scene.square.outline, "#b34a00", 2);
  const name = viewer.addLabel(mean(scene.square.outline), "analysed square").element;
  name.style.marginTop = "28px";
  const numbers = scene.patches.map((one) => viewer.addLabel(mean(one.outline), one.patch).element);
  let outlines = [];
  // From afar the patches would cover each other: one name stands for them.
  viewer.onrender = () => {
    const boxes = numbers.map((number) => number.getBoundingClientRect());
    const width = Math.max(...boxes.map((box) => box.x)) - Math.min(...boxes.map((box) => box.x));
    const isNear = width > 18 * Math.sqrt(numbers.length) || numbers.length === 1;
    for (const number of numbers) number.style.opacity = isNear ? 1 : 0;
    name.style.opacity = isNear ? 0 : 1;
    if (isNear === Boolean(outlines.length)) return;
    for (const outline of outlines) outline.remove();
    outlines = isNear
      ? scene.patches.map((one) => viewer.addOutline(one.outline, "#005a8f", 1)) : [];
  };
  const second = scene.second && viewer.addStone(scene.second);
  const whole = () => {
    const [width, height] = scene.extent;
    const ratio = element.clientWidth / element.clientHeight;
    const size = ratio > 1 ? Math.max(height, width / ratio) : Math.max(width, height * ratio);
    if (second) second.show(true);
    viewer.fit(scene.middle, scene.view, axes[1], 1.1 * size);
  };
  const square = () => {
    if (second) second.show(false); // it would lie over the square
    viewer.fit(mean(scene.square.outline), axes[2], axes[1], 1.15 * size);
  };
  document.getElementById("see-tool").onclick = whole;
  document.getElementById("see-square").onclick = square;
  whole();

  // What is printed in place of the view, which a browser may have thrown away.
  const still = document.getElementById("still");
  const keepStill = () => {
    viewer.snapshot();
    const view = element.querySelector("canvas");
    [still.width, still.height] = [view.width, view.height];
    still.getContext("2d").drawImage(view, 0, 0);
  };
  window.addEventListener("beforeprint", keepStill);
  keepStill();

  const lights = ["azimuth", "altitude"].map((name) => document.getElementById(name));
  for (const light of lights)
    light.addEventListener("input", () => viewer.rake(...lights.map((one) => Number(one.value))));

  if (scene.second) {
    const lifted = document.getElementById("lift");
    const lift = () => {
      second.show(true);
      second.shift(axes[2].map((part) => part * size * Number(lifted.value)));
    };
    lifted.addEventListener("input", lift);
    lift();
  }

  viewer.onclick = (hit) => {
    if (!hit || dot(hit.normal, axes[2]) < 0) return;
    const [x, y] = axes.map((axis) => dot(axis, hit.point.map((value, k) => value - origin[k])));
    const inside = ({ flat }) => flat.every(([ax, ay], k) => {
      const [bx, by] = flat[(k + 1) % 4];
      return (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0;
    });
    const found = scene.patches.find(inside);
    if (found) openCard(`#patch-${found.patch}`);
  };

  // The page scrolls past the tool: the wheel zooms once the tool has been clicked, and a finger
  // that moves up or down scrolls.
  const canvas = element.querySelector("canvas");
  canvas.style.touchAction = "pan-y";
  const passOn = (event) => document.activeElement === canvas || event.stopPropagation();
  element.addEventListener("wheel", passOn, { capture: true });
}
