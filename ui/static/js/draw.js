// Drawing zones and erasing on the map: corners are set by pointer, or by a cross that arrow keys and buttons move.

/* global L */

import { ask, on } from "./link.js";
import { follow, headingInMap, map, onPress, toMap, toScreen } from "./map_view.js";
import { $, freeName, now, say, setText } from "./page.js";
import { onStop } from "./stop.js";
import { onTab } from "./tabs.js";

const WORDS = { keep_out: "keep out", slow: "slow", one_way: "one way", erase: "erase" };
const STEP_PX = 16;
const FAR = 4; // with Shift
const TOOLS = Object.keys(WORDS);

let tool = null;
let corners = [];
let cross = null; // in map [m]

const shape = L.polygon([], { className: "draft", interactive: false }).addTo(map);
const dots = L.layerGroup().addTo(map);
const icon = L.divIcon({ className: "cross-mark", iconSize: [44, 44], iconAnchor: [22, 22] });
const mark = L.marker([0, 0], { icon, interactive: false, keyboard: false });

/** Whether a zone is being drawn: a press on the map then sets a corner. */
export const draws = () => tool !== null;

function choose(name) {
  if (tool === name) {
    giveUp();
    return;
  }
  tool = name;
  corners = [];
  cross = toMap(map.getCenter());
  follow(false);
  mark.addTo(map);
  $("draw-form").hidden = false;
  $("draw-name-part").hidden = name === "erase";
  $("draw-speed-part").hidden = name !== "slow";
  $("draw-heading-part").hidden = name !== "one_way";
  $("draw-name").value = "";
  propose();
  document.body.classList.add("draws");
  show();
}

/** The default name of the zone. */
const proposed = () => freeName(WORDS[tool], now.layout.zones);
const propose = () => tool && ($("draw-name").placeholder = proposed());

function giveUp() {
  tool = null;
  corners = [];
  mark.remove();
  $("draw-form").hidden = true;
  document.body.classList.remove("draws");
  show();
}

/** The polygon of the corners; two corners span an upright rectangle. */
function polygon() {
  if (corners.length !== 2) return corners;
  const [a, c] = corners.map(toScreen);
  return [a, [a[0], c[1]], c, [c[0], a[1]]].map(([lat, lng]) => toMap({ lat, lng }));
}

function show() {
  for (const name of TOOLS) $(`draw-${name}`).setAttribute("aria-pressed", String(tool === name));
  shape.setLatLngs(polygon().map(toScreen));
  dots.clearLayers();
  for (const corner of corners) {
    L.circleMarker(toScreen(corner), { className: "draft-dot", radius: 6, interactive: false }).addTo(dots);
  }
  if (cross) mark.setLatLng(toScreen(cross));
  $("draw-done").disabled = corners.length < 2;
  $("draw-back").disabled = corners.length < 1;
  setText($("draw-said"), tool ? `${corners.length} corners set.${corners.length < 2 ? " Set at least two." : ""}` : "");
}

function setCorner(at) {
  corners.push(at);
  show();
}

/** Moves the cross by steps to the right and up, and scrolls it into view. */
function move(right, up, steps = 1) {
  const way = L.point(right, -up).multiplyBy(STEP_PX * steps);
  cross = toMap(map.unproject(map.project(toScreen(cross)).add(way))); // in projected pixels, since screen pixels are rounded
  map.panInside(toScreen(cross), { padding: [40, 40], animate: false });
  show();
}

async function finish() {
  if (corners.length < 2) return;
  const asked = { polygon: polygon() };
  if (tool !== "erase") {
    asked.name = $("draw-name").value.trim() || proposed();
    asked.rule = tool;
    if (tool === "slow") asked.speed = Number($("draw-speed").value);
    if (tool === "one_way") asked.heading = headingInMap((Number($("draw-heading").value) * Math.PI) / 180);
  }
  if (await say(ask(tool === "erase" ? "erase" : "set_zone", asked))) giveUp();
}

for (const name of TOOLS) $(`draw-${name}`).addEventListener("click", () => choose(name));
$("draw-corner").addEventListener("click", () => setCorner([...cross]));
$("draw-done").addEventListener("click", finish);
$("draw-no").addEventListener("click", giveUp);
$("draw-back").addEventListener("click", () => {
  corners.pop();
  show();
});
for (const button of document.querySelectorAll("[data-cross]")) {
  button.addEventListener("click", () => move(...button.dataset.cross.split(",").map(Number)));
}
onPress((at) => {
  if (!tool) return;
  cross = at;
  setCorner([...at]);
});

const KEYS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };

$("map").addEventListener(
  "keydown",
  (event) => {
    if (!tool) return;
    if (event.key in KEYS) move(...KEYS[event.key], event.shiftKey ? FAR : 1);
    else if (event.key === "Enter") setCorner([...cross]);
    else if (event.key === "Backspace" && corners.length) $("draw-back").click();
    else return;
    event.preventDefault();
    event.stopImmediatePropagation(); // otherwise the map would move, too
  },
  true,
);

onStop(() => tool && giveUp());
onTab((tab) => tab !== "edit" && tool && giveUp());
on("map", () => tool && show());
on("layout", propose);
