/* The square on a stone, from three corners: reference, end of x, end of y (mm, in the mesh's frame).

   A frame is {origin, x, y, normal}; a click is {point, normal}, as `stoneViewer` picks it. */

"use strict";

const add = (a, b, factor = 1) => a.map((value, k) => value + factor * b[k]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [0, 1, 2].map((k) => a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3]);
const unit = (a) => a.map((value) => value / Math.hypot(...a));

/** The frame of three points, as gstlib makes it; null if they are in line. */
function frameOf([origin, first, second]) {
  const [a, b] = [add(first, origin, -1), add(second, origin, -1)];
  const normal = cross(a, b);
  if (!(Math.hypot(...normal) > 0.1 * Math.hypot(...a) * Math.hypot(...b))) return null;
  const x = unit(a);
  return { origin, x, y: cross(unit(normal), x), normal: unit(normal) };
}

/** Directions of x and y at angle 0: y runs up along the stone, as in the view of the whole stone. */
function unturned(normal, [long, middle]) {
  const along = Math.abs(dot(long, normal)) < 0.9 ? long : middle;
  const y = unit(add(along, normal, -dot(along, normal)));
  return { x: cross(y, normal), y };
}

/** The three corners of a square about a point; x is turned towards y. */
function cornersAbout(point, normal, axes, side, degrees) {
  const straight = unturned(normal, axes);
  const angle = (degrees * Math.PI) / 180;
  const x = add(straight.x.map((value) => value * Math.cos(angle)), straight.y, Math.sin(angle));
  const y = cross(normal, x);
  const corner = add(add(point, x, -side / 2), y, -side / 2);
  return [corner, add(corner, x, side), add(corner, y, side)];
}

/** By how many degrees a frame is turned. */
function turnOf(frame, axes) {
  const straight = unturned(frame.normal, axes);
  return (Math.atan2(dot(frame.x, straight.y), dot(frame.x, straight.x)) * 180) / Math.PI;
}

/** Whether the frame of three clicks faces into the stone: they went clockwise. */
const isInward = (frame, clicks) =>
  dot(frame.normal, clicks.map((click) => click.normal).reduce((a, b) => add(a, b))) < 0;

const at = (frame, x, y) => add(add(frame.origin, frame.x, x), frame.y, y);

/** The corners of a footprint on the square. */
function corners(frame, x, y, side, degrees = 0) {
  const [cos, sin] = [Math.cos, Math.sin].map((ratio) => (ratio((degrees * Math.PI) / 180) * side) / 2);
  return [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) =>
    at(frame, x + a * cos - b * sin, y + a * sin + b * cos));
}

/** Draw the square with its axes; returns the marks. */
function drawSquare(viewer, frame, side) {
  return [
    viewer.addOutline(corners(frame, side / 2, side / 2, side), "#c4400a", 3),
    viewer.addLabel(frame.origin, "●"),
    viewer.addLabel(at(frame, -side / 8, -side / 8), "reference"),
    viewer.addLabel(at(frame, 1.04 * side, 0), "x"),
    viewer.addLabel(at(frame, 0, 1.04 * side), "y"),
  ];
}

/** Draw a patch with its name; returns the marks. */
const drawPatch = (viewer, frame, { name, x, y, turn }, side) => [
  viewer.addOutline(corners(frame, x, y, side, turn), "#0b5c8f", 1.5),
  viewer.addLabel(at(frame, x, y), name),
];
