/* A stone that can be turned, drawn by three.js with WebGL, only when something changes.

   const viewer = stoneViewer(element, stone, {label, lift})
     element     an HTML element with a size; a canvas fills it
     stone       what gst.page.viewer.stone_data returns
     options     label: the name that a screen reader says, lift: mm of stone through which lines
                 and labels show, 2 % of its radius by default
     returns     null, with a message in the element, if the browser has no WebGL

   Points, normals and sizes are in the mesh's own coordinates, in mm, as arrays [x, y, z].

     setColours(rgb)        colours of the vertices: base64 of 3 bytes each
     rake(azimuth, altitude)  where light comes from, in degrees: clockwise from the top of the
                            view, and above the plane of the view (90: from behind the viewer)
     addStone(stone)        another, transparent stone; returns {shift(vector), show(is)};
                            shift moves it by a vector (mm) from its original place
     addOutline(points, colour, width)  a closed line, width in pixels; returns {remove()}
     addLabel(point, text)  HTML at a point, hidden while the stone covers it: the returned
                            {element, remove()} can be styled, and listened to once its
                            pointer-events are set to auto
     pick(clientX, clientY) {point, normal} of the surface there, or in the middle of the view
                            without arguments; null beside the stone
     normal(point, radius)  mean normal of the surface within a radius of a point, or null
     fit(point, normal, up, size)  look at a point from along a normal, size mm across; without
                            arguments, at the whole stone, along its shortest axis
     snapshot()             the view without labels, as a data URL of a PNG
     onclick                function(hit, event), called when the view is clicked (not dragged),
                            on or beside the stone, and when Enter clicks its middle;
                            hit as in pick
     onrender               function(), called after each drawing

   Drag, or the arrow keys, turn; the wheel, two fingers, + and - zoom; the right button, two
   fingers, and Shift with the arrow keys pan; Home shows the whole stone; Enter clicks its middle. */

"use strict";

function stoneViewer(element, stone, options = {}) {
  const { label = "Stone in 3D" } = options;
  const background = "#ffffff";
  const canvas = document.createElement("canvas");
  const wanted = { antialias: true, alpha: false };
  const context = canvas.getContext("webgl2", wanted) || canvas.getContext("webgl", wanted);
  if (!context) {
    element.textContent = "This browser cannot draw in 3D: switch on WebGL, or use another browser.";
    return null;
  }
  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const vector = (point) => new THREE.Vector3(...point);
  const centre = vector(stone.centre);
  const inside = (point) => vector(point).sub(centre); // coordinates about the centre
  const radius = vector(stone.bounds[1]).distanceTo(vector(stone.bounds[0])) / 2;
  const depth = 6 * radius; // of the space that is drawn
  const lift = options.lift || 0.02 * radius;

  // --- the scene

  const renderer = new THREE.WebGLRenderer({ canvas, context });
  renderer.setClearColor(background);
  const scene = new THREE.Scene();
  const marks = new THREE.Group();
  const camera = new THREE.OrthographicCamera(-1, 1, 1, -1, 0, depth);
  const light = new THREE.DirectionalLight();
  camera.add(light, light.target); // the light turns with the eye
  scene.add(camera, marks, new THREE.AmbientLight("#ffffff", 0.4));
  function shapeOf(of) {
    const shape = new THREE.BufferGeometry();
    const places = new Float32Array(bytes(of.vertices).buffer);
    shape.setAttribute("position", new THREE.BufferAttribute(places, 3));
    shape.setIndex(new THREE.BufferAttribute(new Uint32Array(bytes(of.faces).buffer), 1));
    shape.computeVertexNormals();
    return shape;
  }

  const geometry = shapeOf(stone);
  const [vertices, normals] = [geometry.attributes.position.array, geometry.attributes.normal.array];
  const material = new THREE.MeshLambertMaterial({ color: "#aaa397", side: THREE.DoubleSide });
  const mesh = new THREE.Mesh(geometry, material);
  scene.add(mesh);

  function addStone(other) {
    const look = { color: "#6f8fa8", transparent: true, opacity: 0.3, depthWrite: false, side: THREE.DoubleSide };
    const part = new THREE.Mesh(shapeOf(other), new THREE.MeshLambertMaterial(look));
    const shift = (by) => {
      part.position.copy(inside(other.centre)).add(vector(by));
      render();
    };
    scene.add(part);
    shift([0, 0, 0]);
    const show = (is) => { part.visible = is; render(); };
    return { shift, show };
  }

  function setColours(rgb) {
    geometry.setAttribute("color", new THREE.BufferAttribute(bytes(rgb), 3, true));
    material.color.set("#ffffff");
    material.vertexColors = true;
    material.needsUpdate = true;
    render();
  }

  function rake(azimuth, altitude) {
    const [turn, height] = [azimuth, altitude].map(THREE.MathUtils.degToRad);
    const flat = Math.cos(height);
    light.position.set(flat * Math.sin(turn), flat * Math.cos(turn), Math.sin(height));
    // What faces the eye stays as bright, down to 30 degrees.
    light.intensity = 0.5 / Math.max(Math.sin(height), 0.5);
    render();
  }

  // --- where the eye is: what it looks at, how it is turned, and how many mm it sees

  const target = new THREE.Vector3();
  const turned = new THREE.Quaternion();
  let span = 2 * radius;

  const axis = (x, y, z) => new THREE.Vector3(x, y, z).applyQuaternion(turned);
  const pixel = () => span / Math.min(element.clientWidth, element.clientHeight); // mm

  function turn(right, down) {
    // By radians; the axis lies in the view, across the movement.
    const angle = Math.hypot(right, down);
    if (angle) turned.premultiply(new THREE.Quaternion().setFromAxisAngle(
      axis(-down / angle, -right / angle, 0), angle));
    render();
  }

  function pan(right, down) {
    target.addScaledVector(axis(1, 0, 0), -right * pixel());
    target.addScaledVector(axis(0, 1, 0), down * pixel()).clampLength(0, radius);
    render();
  }

  function zoom(factor, clientX, clientY) {
    // What lies under the pointer stays there.
    const box = canvas.getBoundingClientRect();
    const before = span;
    span = Math.min(Math.max(span / factor, radius / 500), 4 * radius);
    const share = 1 - before / span;
    const x = clientX === undefined ? 0 : clientX - box.left - box.width / 2;
    const y = clientY === undefined ? 0 : clientY - box.top - box.height / 2;
    pan(x * share, y * share);
  }

  function fit(point, normal, up, size) {
    const [towards, upright] = [normal || stone.axes[2], up || stone.axes[0]].map(vector);
    turned.setFromRotationMatrix(
      new THREE.Matrix4().lookAt(towards, new THREE.Vector3(), upright));
    target.copy(point ? inside(point) : new THREE.Vector3());
    span = size || 2 * radius;
    render();
  }

  // --- drawing

  let asked = false;
  function render() {
    if (!asked) requestAnimationFrame(draw);
    asked = true;
  }

  function draw() {
    asked = false;
    const [width, height] = [element.clientWidth, element.clientHeight];
    if (!width || !height) return;
    const ratio = Math.min(window.devicePixelRatio, 2);
    if (canvas.width !== Math.floor(width * ratio) || canvas.height !== Math.floor(height * ratio)) {
      renderer.setPixelRatio(ratio);
      renderer.setSize(width, height);
    }
    camera.right = (width * pixel()) / 2;
    camera.top = (height * pixel()) / 2;
    [camera.left, camera.bottom] = [-camera.right, -camera.top];
    camera.quaternion.copy(turned);
    camera.position.copy(target).addScaledVector(axis(0, 0, 1), depth / 2);
    camera.updateProjectionMatrix();
    scene.updateMatrixWorld();
    half.value.set(width / 2, height / 2);
    placeLabels(width, height);
    placeScale();
    renderer.render(scene, camera);
    if (viewer.onrender) viewer.onrender();
  }

  function snapshot() {
    draw();
    return canvas.toDataURL("image/png");
  }

  // --- lines: quads of constant width in pixels, a little nearer to the eye than they are

  const half = { value: new THREE.Vector2(1, 1) }; // the view's half size, in pixels
  const VERTEX = `
    attribute vec3 other; attribute float side;
    uniform vec2 half_size; uniform float width; uniform float nearer;
    void main() {
      mat4 all = projectionMatrix * modelViewMatrix;
      vec4 here = all * vec4(position, 1.0);
      vec2 along = ((all * vec4(other, 1.0)).xy - here.xy) * half_size;
      along /= max(length(along), 1e-6);
      vec2 offset = width * (side * vec2(-along.y, along.x) - along);
      gl_Position = here + vec4(offset / half_size, -nearer, 0.0);
    }`;
  const FRAGMENT = "uniform vec3 colour; void main() { gl_FragColor = vec4(colour, 1.0); }";

  function addOutline(points, colour, width) {
    const ends = [...points, points[0]].map(inside);
    const [position, other, side, index] = [[], [], [], []];
    for (let k = 0; k + 1 < ends.length; k++) {
      const [a, b] = [ends[k].toArray(), ends[k + 1].toArray()];
      position.push(...a, ...a, ...b, ...b);
      other.push(...b, ...b, ...a, ...a);
      side.push(1, -1, -1, 1);
      index.push(...[0, 1, 2, 2, 1, 3].map((corner) => 4 * k + corner));
    }
    const shape = new THREE.BufferGeometry();
    shape.setAttribute("position", new THREE.Float32BufferAttribute(position, 3));
    shape.setAttribute("other", new THREE.Float32BufferAttribute(other, 3));
    shape.setAttribute("side", new THREE.Float32BufferAttribute(side, 1));
    shape.setIndex(index);
    const line = new THREE.Group();
    // A white rim keeps every colour in sight.
    for (const [paint, pixels, above] of [["#ffffff", width + 2, 0.9], [colour, width, 1]]) {
      const uniforms = {
        half_size: half,
        width: { value: pixels / 2 },
        nearer: { value: (2 * above * lift) / depth },
        colour: { value: new THREE.Color(paint) },
      };
      const look = { uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT };
      const part = new THREE.Mesh(
        shape, new THREE.ShaderMaterial({ ...look, side: THREE.DoubleSide }));
      part.frustumCulled = false;
      line.add(part);
    }
    marks.add(line);
    render();
    return {
      remove() {
        marks.remove(line);
        shape.dispose();
        render();
      },
    };
  }

  // --- labels: HTML, hidden where the stone is nearer to the eye by the depth of a small picture

  const labels = new Set();
  const depths = new THREE.WebGLRenderTarget(1, 1);
  const depthMaterial = new THREE.MeshDepthMaterial({ side: THREE.DoubleSide });
  depthMaterial.depthPacking = THREE.RGBADepthPacking;

  function addLabel(point, text) {
    const tag = document.createElement("span");
    tag.textContent = text;
    tag.style.cssText = "position:absolute;left:0;top:0;pointer-events:none;color:#000;" +
      "font:600 13px system-ui,sans-serif;text-shadow:0 0 3px #fff,0 0 3px #fff,0 0 3px #fff";
    frame.append(tag);
    const entry = { element: tag, place: inside(point) };
    labels.add(entry);
    render();
    return {
      element: tag,
      remove() {
        tag.remove();
        labels.delete(entry);
      },
    };
  }

  function placeLabels(width, height) {
    if (!labels.size) return;
    const [columns, rows] = [width, height].map((length) => Math.ceil(length / 3));
    depths.setSize(columns, rows);
    marks.visible = false;
    scene.overrideMaterial = depthMaterial;
    renderer.setRenderTarget(depths);
    renderer.setClearColor("#ffffff", 1);
    renderer.clear();
    renderer.render(scene, camera);
    const values = new Uint8Array(4 * columns * rows);
    renderer.readRenderTargetPixels(depths, 0, 0, columns, rows, values);
    renderer.setRenderTarget(null);
    renderer.setClearColor(background);
    scene.overrideMaterial = null;
    marks.visible = true;
    for (const { element: tag, place } of labels) {
      const seen = place.clone().project(camera);
      const [x, y] = [(seen.x + 1) / 2, (seen.y + 1) / 2];
      const at = 4 * (Math.floor(y * rows) * columns + Math.floor(x * columns));
      const stoneDepth = values[at + 3] / 256 + values[at + 2] / 65536;
      const isIn = x > 0 && x < 1 && y > 0 && y < 1;
      const isCovered = (seen.z + 1) / 2 - (2 * lift) / depth > stoneDepth;
      tag.style.visibility = isIn && !isCovered ? "visible" : "hidden";
      tag.style.transform =
        `translate(${x * width}px,${(1 - y) * height}px) translate(-50%,-50%)`;
    }
  }

  // --- a scale bar

  const scale = document.createElement("span");
  scale.style.cssText = "position:absolute;left:12px;bottom:10px;border-bottom:3px solid #000;" +
    "font:12px system-ui,sans-serif;text-align:center;pointer-events:none;color:#000";
  function placeScale() {
    const most = 120 * pixel();
    const power = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].find((step) => step * power <= most) * power;
    scale.textContent = `${+length.toPrecision(1)} mm`;
    scale.style.width = `${length / pixel()}px`;
  }

  // --- what lies under the pointer, and around a point

  const ray = new THREE.Raycaster();
  function pick(clientX, clientY) {
    const box = canvas.getBoundingClientRect();
    const middle = clientX === undefined;
    const x = middle ? 0.5 : (clientX - box.left) / box.width;
    const y = middle ? 0.5 : (clientY - box.top) / box.height;
    ray.setFromCamera(new THREE.Vector2(2 * x - 1, 1 - 2 * y), camera);
    const [hit] = ray.intersectObject(mesh);
    return hit
      ? { point: hit.point.add(centre).toArray(), normal: hit.face.normal.toArray() }
      : null;
  }

  function normal(point, reach) {
    const [x, y, z] = inside(point).toArray();
    const sum = new THREE.Vector3();
    for (let k = 0; k < vertices.length; k += 3) {
      if (Math.hypot(vertices[k] - x, vertices[k + 1] - y, vertices[k + 2] - z) <= reach)
        sum.add(new THREE.Vector3(normals[k], normals[k + 1], normals[k + 2]));
    }
    return sum.length() ? sum.normalize().toArray() : null;
  }

  // --- pointers and keys

  const pointers = new Map();
  let moved = 0;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    if (!pointers.size) moved = 0;
    pointers.set(event.pointerId, event);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
    moved += Math.hypot(dx, dy);
    const other = [...pointers.values()].find((one) => one.pointerId !== event.pointerId);
    if (other) {
      const distance = (one) =>
        Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY) || 1;
      zoom(distance(event) / distance(before), other.clientX, other.clientY);
      pan(dx / 2, dy / 2);
    } else if (before.buttons === 1 && !event.shiftKey) {
      const quarter = Math.min(element.clientWidth, element.clientHeight) / 2; // of a turn
      turn(((Math.PI / 2) * dx) / quarter, ((Math.PI / 2) * dy) / quarter);
    } else pan(dx, dy);
    pointers.set(event.pointerId, event);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => {
      const isLast = pointers.delete(event.pointerId) && !pointers.size;
      if (end === "pointerup" && isLast && moved < 5 && event.button === 0 && viewer.onclick)
        viewer.onclick(pick(event.clientX, event.clientY), event);
    });
  }
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? event.deltaY * 30 : event.deltaY;
    zoom(Math.exp(-lines / 500), event.clientX, event.clientY);
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const arrows = {
      ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1],
    };
    const arrow = arrows[event.key];
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (arrow && event.shiftKey) pan(30 * arrow[0], 30 * arrow[1]);
    else if (arrow) turn(arrow[0] * 0.1, arrow[1] * 0.1);
    else if (event.key === "+" || event.key === "=") zoom(1.2);
    else if (event.key === "-") zoom(1 / 1.2);
    else if (event.key === "Home") fit();
    else if (event.key === "Enter" && viewer.onclick) viewer.onclick(pick(), event);
    else return;
    event.preventDefault();
  });

  canvas.tabIndex = 0;
  canvas.setAttribute("role", "application");
  canvas.setAttribute("aria-label",
    `${label}. Arrow keys turn it, with Shift they move it; plus and minus zoom; Home: all of it; Enter: click the middle.`);
  canvas.style.cssText = "display:block;touch-action:none;cursor:grab";
  const frame = document.createElement("div");
  frame.style.cssText = "position:absolute;inset:0;overflow:hidden";
  frame.append(canvas, scale);
  if (getComputedStyle(element).position === "static") element.style.position = "relative";
  element.append(frame);
  const viewer = {
    setColours, rake, addStone, addOutline, addLabel, pick, normal, fit, snapshot, onclick: null, onrender: null,
  };
  new ResizeObserver(render).observe(element);
  rake(315, 45);
  fit();
  return viewer;
}
