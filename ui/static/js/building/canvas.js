// The storey's map and graph on a canvas: it pans by dragging, wheel and keys, and draws only when something has changed.

import { arcsOf, grid, model, nodesOf, on } from "./model.js";
import { onShown, shown, showAgain, thingAt } from "./state.js";

const screen = document.getElementById("canvas");
const front = screen.getContext("2d", { alpha: false });
const canvas = document.createElement("canvas"); // the scene, larger than the screen, so that panning copies it
const back = canvas.getContext("2d", { alpha: false });
const WIDER = 1.6; // times the screen
const DARK = matchMedia("(prefers-color-scheme: dark)");
const NEAR_PX = 14;
const [LEAST, MOST] = [0.5, 400]; // pixels to the metre
const NAMED_FROM = 24; // pixels to the metre from which on names are shown
const MOST_NAMES = 200;
const AT_ONCE = 40; // lines of one path
const PRESSED_PX = 6; // a pointer that moves less has pressed, not dragged
const PRESSES = new EventTarget();

const view = { x: 0, y: 0, scale: 30 }; // the point [m] in the middle, pixels to the metre
const scene = { x: 0, y: 0, scale: 0, ratio: 0, stale: true };
let context = front; // that which is painted on
let target = screen; // its canvas
let shapes = { nodes: [], arcs: [], marks: [] };
let picture = null;
let colours = {};
let fitted = "";
let wanted = false;
let stale = true; // whether the shapes are older than the model
let gathered = null; // storey of the shapes

export const onPress = (heard) => PRESSES.addEventListener("press", heard);

const ratio = () => window.devicePixelRatio || 1;
const toScreen = (x, y) => [
  target.width / 2 + (x - view.x) * view.scale * ratio(),
  target.height / 2 - (y - view.y) * view.scale * ratio(),
];

function toMap(px, py) {
  const box = screen.getBoundingClientRect();
  return [view.x + (px - box.left - box.width / 2) / view.scale, view.y - (py - box.top - box.height / 2) / view.scale];
}

function readColours() {
  const style = getComputedStyle(document.documentElement);
  colours = Object.fromEntries(
    ["ink", "accent", "bad", "warn", "card", "focus", "soft", "map-path", "map-person", "map-chair", "map-ground"].map((name) => [
      name,
      style.getPropertyValue(`--${name}`).trim(),
    ]),
  );
}

/** Draws in the next frame. */
export function draw() {
  if (wanted) return;
  wanted = true;
  requestAnimationFrame(() => {
    wanted = false;
    paint();
  });
}

function gather() {
  const nodes = nodesOf(shown.storey);
  const at = new Map(nodes.map((node) => [node.ref, node]));
  const arcs = arcsOf(shown.storey)
    .map((arc) => ({ ...arc, one: at.get(arc.ends[0]), other: at.get(arc.ends[1]) }))
    .filter(({ one, other }) => one && other);
  const byRef = new Map(arcs.map((arc) => [arc.ref, arc]));
  const marks = [];
  for (const { place, severity } of model.findings) {
    const node = at.get(place);
    const arc = byRef.get(place);
    if (node) marks.push({ x: node.x, y: node.y, severity });
    else if (arc) marks.push({ x: (arc.one.x + arc.other.x) / 2, y: (arc.one.y + arc.other.y) / 2, severity });
  }
  shapes = { nodes, arcs, marks };
}

/** Paints the view: the scene, which is kept while the view pans within it, and on it all that changes often. */
function paint() {
  const box = screen.getBoundingClientRect();
  const [width, height] = [Math.round(box.width * ratio()), Math.round(box.height * ratio())];
  if (screen.width !== width || screen.height !== height) [screen.width, screen.height] = [width, height];
  if (!width || !height) return;
  const shift = () => [
    ((scene.x - view.x) * view.scale * ratio()) - (canvas.width - width) / 2,
    ((view.y - scene.y) * view.scale * ratio()) - (canvas.height - height) / 2,
  ];
  const holds = ([x, y]) => x <= 0 && y <= 0 && x + canvas.width >= width && y + canvas.height >= height;
  const isSame = scene.scale === view.scale && scene.ratio === ratio() && canvas.width === Math.round(width * WIDER) && canvas.height === Math.round(height * WIDER);
  if (scene.stale || !isSame || !holds(shift())) paintScene(width, height);
  const [x, y] = shift();
  front.setTransform(1, 0, 0, 1, 0, 0);
  front.drawImage(canvas, Math.round(x), Math.round(y));
  context = front;
  target = screen;
  paintChosen();
  paintCross();
}

function paintScene(width, height) {
  [canvas.width, canvas.height] = [Math.round(width * WIDER), Math.round(height * WIDER)];
  Object.assign(scene, { x: view.x, y: view.y, scale: view.scale, ratio: ratio(), stale: false });
  context = back;
  target = canvas;
  context.fillStyle = colours["map-ground"];
  context.fillRect(0, 0, canvas.width, canvas.height);
  paintMap();
  paintZones();
  paintArcs();
  paintNodes();
  paintMarks();
}

function paintMap() {
  if (!picture?.columns || picture.storey !== shown.storey) return;
  const { image, columns, rows, resolution, pose } = picture;
  const size = view.scale * ratio();
  const [x, y] = toScreen(pose[0], pose[1]);
  context.save();
  context.translate(x, y);
  context.rotate(-pose[2]);
  context.imageSmoothingEnabled = resolution * size < 4;
  context.drawImage(image, 0, -rows * resolution * size, columns * resolution * size, rows * resolution * size);
  context.restore();
}

function paintZones() {
  const zones = model.drawn[shown.storey]?.zones ?? [];
  for (const { polygon, rule, name } of zones) {
    outline(polygon, true);
    context.globalAlpha = 0.22;
    context.fillStyle = rule === "keep_out" ? colours.bad : rule === "slow" ? colours.warn : colours.accent;
    context.fill();
    context.globalAlpha = 1;
    context.strokeStyle = context.fillStyle;
    context.lineWidth = 2 * ratio();
    context.stroke();
    label(name, ...polygon[0]);
  }
}

function outline(corners, closed) {
  context.beginPath();
  for (const [x, y] of corners) context.lineTo(...toScreen(x, y));
  if (closed) context.closePath();
}

/** Whether a box of the map is in view, by two of its corners. */
function inView(x1, y1, x2 = x1, y2 = y1) {
  const half = [target.width / 2 / view.scale / ratio() + 1, target.height / 2 / view.scale / ratio() + 1];
  return (
    Math.max(x1, x2) > view.x - half[0] &&
    Math.min(x1, x2) < view.x + half[0] &&
    Math.max(y1, y2) > view.y - half[1] &&
    Math.min(y1, y2) < view.y + half[1]
  );
}

function paintArcs() {
  const wide = Math.max(1, Math.min(3, view.scale / 12)) * ratio();
  const seen = shapes.arcs.filter(({ one, other }) => inView(one.x, one.y, other.x, other.y));
  for (const [colour, dash, which] of [
    [colours["map-path"], [], ({ closed, door }) => !closed && !door],
    [colours["map-person"], [], ({ closed, door }) => !closed && door],
    [colours.bad, [6, 4], ({ closed }) => Boolean(closed)],
  ]) {
    context.setLineDash(dash.map((length) => length * ratio()));
    context.strokeStyle = colour;
    context.lineWidth = wide;
    const lines = seen.filter(which);
    for (let first = 0; first < lines.length; first += AT_ONCE) {
      context.beginPath(); // a path of thousands of lines is slow to fill without a graphics card
      for (const { one, other } of lines.slice(first, first + AT_ONCE)) {
        context.moveTo(...toScreen(one.x, one.y));
        context.lineTo(...toScreen(other.x, other.y));
      }
      context.stroke();
    }
  }
  context.setLineDash([]);
  for (const arc of seen) if (arc.oneWay) arrow(arc);
}

function arrow({ one, other, outwards }) {
  const [from, to] = outwards ? [other, one] : [one, other];
  const [x, y] = toScreen((from.x + 2 * to.x) / 3, (from.y + 2 * to.y) / 3);
  const angle = Math.atan2(-(to.y - from.y), to.x - from.x);
  context.beginPath();
  for (const turn of [0, 2.6, -2.6]) {
    context.lineTo(x + 9 * ratio() * Math.cos(angle + turn), y + 9 * ratio() * Math.sin(angle + turn));
  }
  context.fillStyle = colours["map-path"];
  context.fill();
}

const SHAPES = { end: "disc", cross: "dot", door: "square", lift: "diamond" };

function paintNodes() {
  const seen = shapes.nodes.filter(({ x, y }) => inView(x, y));
  const size = sizeOfNodes();
  for (const kind in SHAPES) {
    const stamp = stampOf(kind, size);
    const half = stamp.width / 2;
    for (const node of seen) {
      if (node.kind !== kind) continue;
      const [x, y] = toScreen(node.x, node.y);
      context.drawImage(stamp, Math.round(x - half), Math.round(y - half));
    }
  }
  if (view.scale >= NAMED_FROM && seen.length <= MOST_NAMES) for (const node of seen) if (node.name) label(node.name, node.x, node.y);
}

const sizeOfNodes = () => Math.max(2, Math.min(7, view.scale / 6)) * ratio();

/** A small picture of a node, which is copied to each place. */
function stampOf(kind, size) {
  const stamp = document.createElement("canvas");
  stamp.width = stamp.height = 2 * Math.ceil(1.6 * size + 2);
  const on = stamp.getContext("2d");
  on.beginPath();
  shape(on, SHAPES[kind], stamp.width / 2, stamp.width / 2, size);
  on.fillStyle = kind === "end" ? colours.accent : kind === "lift" ? colours["map-chair"] : colours.ink;
  on.fill();
  if (kind === "end" || kind === "lift") {
    on.strokeStyle = colours.card;
    on.lineWidth = ratio();
    on.stroke();
  }
  return stamp;
}

/** The selected thing and the marked nodes. */
function paintChosen() {
  const { kind, ref } = shown.selected ?? {};
  const size = sizeOfNodes();
  for (const node of shapes.nodes) {
    if (kind === "node" && node.ref === ref) ring(node, colours.focus, size + 6 * ratio());
    if (shown.marked.has(node.ref)) ring(node, colours.warn, size + 3 * ratio());
  }
  const arc = kind === "arc" && shapes.arcs.find((each) => each.ref === ref);
  if (arc) {
    context.beginPath();
    context.moveTo(...toScreen(arc.one.x, arc.one.y));
    context.lineTo(...toScreen(arc.other.x, arc.other.y));
    context.strokeStyle = colours.focus;
    context.lineWidth = 6 * ratio();
    context.stroke();
  }
  if (!shown.corners.length) return;
  outline(shown.corners, false);
  context.strokeStyle = colours.focus;
  context.lineWidth = 2 * ratio();
  context.stroke();
}

function shape(context, form, x, y, size) {
  if (form === "square") context.rect(x - size, y - size, 2 * size, 2 * size);
  else if (form === "diamond") {
    const far = 1.6 * size;
    context.moveTo(x, y - far);
    for (const [dx, dy] of [[far, 0], [0, far], [-far, 0]]) context.lineTo(x + dx, y + dy);
    context.closePath();
  } else {
    const radius = form === "disc" ? 1.3 * size : 0.8 * size;
    context.moveTo(x + radius, y);
    context.arc(x, y, radius, 0, 2 * Math.PI);
  }
}

function ring({ x, y }, colour, radius) {
  context.beginPath();
  context.arc(...toScreen(x, y), radius, 0, 2 * Math.PI);
  context.strokeStyle = colour;
  context.lineWidth = 3 * ratio();
  context.stroke();
}

function label(text, x, y) {
  const [px, py] = toScreen(x, y);
  context.font = `${13 * ratio()}px system-ui, sans-serif`;
  context.lineWidth = 3 * ratio();
  context.strokeStyle = colours.card;
  context.fillStyle = colours.ink;
  context.strokeText(text, px + 9 * ratio(), py - 7 * ratio());
  context.fillText(text, px + 9 * ratio(), py - 7 * ratio());
}

/** Faults: triangles for errors, outlined triangles for warnings. */
function paintMarks() {
  const size = 8 * ratio();
  for (const severity of ["warning", "error"]) {
    context.fillStyle = severity === "error" ? colours.bad : colours.card;
    context.strokeStyle = severity === "error" ? colours.card : colours.warn;
    context.lineWidth = 2 * ratio();
    for (const mark of shapes.marks) {
      if (mark.severity !== severity || !inView(mark.x, mark.y)) continue;
      const [x, y] = toScreen(mark.x, mark.y);
      context.beginPath();
      context.moveTo(x, y - 2.6 * size);
      context.lineTo(x + size, y - size);
      context.lineTo(x - size, y - size);
      context.closePath();
      context.fill();
      context.stroke();
    }
  }
}

function paintCross() {
  const [x, y] = toScreen(...shown.cross);
  const size = 14 * ratio();
  for (const [colour, width] of [[colours.card, 5], [colours.focus, 2.5]]) {
    context.beginPath();
    context.moveTo(x - size, y);
    context.lineTo(x + size, y);
    context.moveTo(x, y - size);
    context.lineTo(x, y + size);
    context.strokeStyle = colour;
    context.lineWidth = width * ratio();
    context.stroke();
  }
}

/** The thing at the cross: {kind, ref}; null without one nearby. */
export function thingAtCross(without = "") {
  const [x, y] = shown.cross;
  let best = NEAR_PX / view.scale;
  let found = null;
  for (const node of shapes.nodes) {
    const far = Math.hypot(node.x - x, node.y - y);
    if (far <= best && node.ref !== without) [best, found] = [far, { kind: "node", ref: node.ref }];
  }
  if (found) return found;
  for (const arc of shapes.arcs) {
    const far = distance(arc, x, y);
    if (far <= best) [best, found] = [far, { kind: "arc", ref: arc.ref }];
  }
  return found;
}

function distance({ one, other }, x, y) {
  const [dx, dy] = [other.x - one.x, other.y - one.y];
  const along = Math.max(0, Math.min(1, ((x - one.x) * dx + (y - one.y) * dy) / (dx * dx + dy * dy || 1)));
  return Math.hypot(one.x + along * dx - x, one.y + along * dy - y);
}

/** Moves the view so that the cross is in it. */
function keepInView() {
  target = screen;
  const [x, y] = toScreen(...shown.cross);
  const margin = 40 * ratio();
  if (x < margin || y < margin || x > screen.width - margin || y > screen.height - margin) [view.x, view.y] = shown.cross;
}

export function moveCross(dx, dy) {
  shown.cross = [Math.round((shown.cross[0] + dx) * 1e4) / 1e4, Math.round((shown.cross[1] + dy) * 1e4) / 1e4];
  showAgain();
}

export function zoom(times, at = [view.x, view.y]) {
  const scale = Math.max(LEAST, Math.min(MOST, view.scale * times));
  [view.x, view.y] = [0, 1].map((i) => at[i] + (([view.x, view.y][i] - at[i]) * view.scale) / scale);
  view.scale = scale;
  draw();
}

/** Shows the whole storey. */
export function fit() {
  const corners = shapes.nodes.map(({ x, y }) => [x, y]);
  if (picture?.storey === shown.storey) {
    const { columns, rows, resolution, pose } = picture;
    for (const [c, r] of [[0, 0], [columns, 0], [0, rows], [columns, rows]]) {
      const [dx, dy] = [c * resolution, r * resolution];
      corners.push([
        pose[0] + dx * Math.cos(pose[2]) - dy * Math.sin(pose[2]),
        pose[1] + dx * Math.sin(pose[2]) + dy * Math.cos(pose[2]),
      ]);
    }
  }
  if (!corners.length) return;
  const [low, high] = [Math.min, Math.max].map((most) => [0, 1].map((i) => corners.reduce((a, each) => most(a, each[i]), corners[0][i])));
  [view.x, view.y] = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
  const box = screen.getBoundingClientRect();
  const fits = Math.min(box.width / (high[0] - low[0] + 2), box.height / (high[1] - low[1] + 2));
  view.scale = Math.max(LEAST, Math.min(MOST, fits));
  if (fitted !== shown.storey) shown.cross = [Math.round(view.x * 4) / 4, Math.round(view.y * 4) / 4];
  draw();
}

async function show() {
  const { storey } = shown;
  if (stale || gathered !== storey) {
    gather();
    scene.stale = true;
  }
  [stale, gathered] = [false, storey];
  const folder = model.storeys.find(({ id }) => id === storey)?.map ?? "";
  if (picture?.storey !== storey || picture.folder !== folder) {
    const found = folder ? await grid(storey, DARK.matches ? "dark" : "light") : null;
    if (storey !== shown.storey) return;
    picture = { ...found, storey, folder, image: found?.image };
    scene.stale = true;
    if (!found) picture = { storey, folder, image: null, columns: 0, rows: 0, resolution: 1, pose: [0, 0, 0] };
    if (fitted !== storey) {
      fit();
      fitted = storey;
      showAgain();
    }
  }
  keepInView();
  draw();
}

let dragged = null;

screen.addEventListener("pointerdown", (event) => {
  dragged = { x: event.clientX, y: event.clientY, moved: false };
  screen.setPointerCapture(event.pointerId);
  screen.focus();
});
screen.addEventListener("pointermove", (event) => {
  if (!dragged) return;
  const [dx, dy] = [event.clientX - dragged.x, event.clientY - dragged.y];
  if (!dragged.moved && Math.hypot(dx, dy) < PRESSED_PX) return;
  Object.assign(dragged, { x: event.clientX, y: event.clientY, moved: true });
  pan(dx, dy);
});
screen.addEventListener("pointerup", (event) => {
  if (dragged && !dragged.moved) {
    shown.cross = toMap(event.clientX, event.clientY).map((value) => Math.round(value * 100) / 100);
    showAgain();
    PRESSES.dispatchEvent(new Event("press"));
  }
  dragged = null;
});
screen.addEventListener("pointercancel", () => (dragged = null));
screen.addEventListener(
  "wheel",
  (event) => {
    event.preventDefault();
    zoom(Math.exp(-event.deltaY / 500), toMap(event.clientX, event.clientY));
  },
  { passive: false },
);

/** Moves the view by pixels. */
export function pan(dx, dy) {
  view.x -= dx / view.scale;
  view.y += dy / view.scale;
  draw();
}

on("change", () => {
  stale = true;
  scene.stale = true;
  show();
});
onShown(show);
DARK.addEventListener("change", () => {
  readColours();
  picture = null;
  scene.stale = true;
  show();
});
new ResizeObserver(draw).observe(screen);
readColours();
