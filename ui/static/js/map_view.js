// The map: Leaflet with the metre as unit, in the grid's own frame, so that a grid may be rotated in map.

/* global L */

import { on, picture } from "./link.js";
import { Overlay } from "./overlay.js";
import { $, now } from "./page.js";

const STILL = matchMedia("(prefers-reduced-motion: reduce)");
const DARK = matchMedia("(prefers-color-scheme: dark)");
const RULES = { keep_out: "keep out", slow: "slow", one_way: "one way" };
const NEAR = 4.5; // 23 px to the metre
const EDGE = 0.44; // share of the map's width and height, from its middle, in which the chair may move
const CLICKS = new EventTarget();

let frame = { x: 0, y: 0, theta: 0 }; // map_from_grid
let meta = null;
let image = null;
let following = true;
let seen = false;

export const map = L.map("map", {
  crs: L.CRS.Simple,
  minZoom: 2,
  maxZoom: 8,
  zoomSnap: 0.25,
  maxBoundsViscosity: 0.8,
  zoomControl: false,
  attributionControl: false,
  zoomAnimation: !STILL.matches,
  fadeAnimation: false,
  markerZoomAnimation: !STILL.matches,
  keyboardPanDelta: 60,
}).setView([0, 0], 5);

const overlay = new Overlay().addTo(map);
const zones = L.layerGroup().addTo(map);
const places = L.layerGroup().addTo(map);

/** [lat, lng] of a point in map [m]. */
export function toScreen([x, y]) {
  const [dx, dy] = [x - frame.x, y - frame.y];
  const [c, s] = [Math.cos(frame.theta), Math.sin(frame.theta)];
  return [c * dy - s * dx, c * dx + s * dy];
}

/** A point in map [m] of [lat, lng]. */
export function toMap({ lat, lng }) {
  const [c, s] = [Math.cos(frame.theta), Math.sin(frame.theta)];
  return [frame.x + c * lng - s * lat, frame.y + s * lng + c * lat];
}

/** The heading in map of a heading on the screen, both in radians from the right, counter-clockwise. */
export const headingInMap = (onScreen) => onScreen + frame.theta;

/** Registers a listener for presses on the map: [x, y] in map. */
export const onPress = (heard) => CLICKS.addEventListener("press", (event) => heard(event.detail));

/** Registers a listener for presses on a place's pin. */
export const onPlace = (heard) => CLICKS.addEventListener("place", (event) => heard(event.detail));

export function follow(whether) {
  following = whether;
  $("follow").setAttribute("aria-pressed", String(whether));
  if (whether && now.view?.pose) centre(false);
}

async function drawMap() {
  if (!meta) return;
  const drawn = meta;
  const url = await picture(`api/grid.png?theme=${DARK.matches ? "dark" : "light"}&revision=${drawn.revision}`);
  if (!url || drawn !== meta) return;
  const [columns, rows] = drawn.cells;
  const bounds = [[0, 0], [rows * drawn.resolution, columns * drawn.resolution]];
  const older = image;
  image = L.imageOverlay(url, bounds, { className: "grid", alt: "" }).addTo(map);
  image.bringToBack();
  image.once("load", () => {
    older?.remove();
    if (older) URL.revokeObjectURL(older._url);
  });
  [frame.x, frame.y, frame.theta] = drawn.origin;
  drawLayout();
  map.setMaxBounds(L.latLngBounds(bounds).pad(0.1));
  if (!seen) {
    seen = true;
    map.fitBounds(bounds, { animate: false, padding: [24, 24] });
    if (now.view?.pose && map.getZoom() < NEAR) centre(true, NEAR); // the whole floor would show a tiny chair
  }
}

function drawLayout() {
  zones.clearLayers();
  places.clearLayers();
  for (const zone of now.layout.zones) {
    const corners = zone.polygon.map(toScreen);
    L.polygon(corners, { className: `zone ${zone.rule}`, interactive: false }).addTo(zones);
    const name = L.divIcon({ className: "zone-name", html: span(`${zone.name}: ${RULES[zone.rule]}`), iconSize: [0, 0] });
    const box = L.latLngBounds(corners);
    const top = [box.getNorth(), box.getCenter().lng];
    L.marker(top, { icon: name, interactive: false, keyboard: false }).addTo(zones);
    if (zone.rule === "one_way") drawArrow(zone);
  }
  for (const place of now.layout.places) {
    const icon = L.divIcon({ className: "place-pin", html: span(place.name), iconSize: [44, 44], iconAnchor: [22, 22] });
    // the list holds the same places for keyboard and screen reader
    L.marker(toScreen(place.pose), { icon, keyboard: false })
      .on("click", () => CLICKS.dispatchEvent(new CustomEvent("place", { detail: place })))
      .addTo(places);
  }
}

function span(text) {
  const made = document.createElement("span");
  made.textContent = text;
  return made;
}

function drawArrow({ polygon, value }) {
  const middle = polygon.reduce(([x, y], [px, py]) => [x + px / polygon.length, y + py / polygon.length], [0, 0]);
  const ahead = (along, aside) => [
    middle[0] + along * Math.cos(value) - aside * Math.sin(value),
    middle[1] + along * Math.sin(value) + aside * Math.cos(value),
  ];
  const line = [ahead(-0.5, 0), ahead(0.5, 0), ahead(0.25, 0.2), ahead(0.5, 0), ahead(0.25, -0.2)];
  L.polyline(line.map(toScreen), { className: "zone one_way arrow-line", interactive: false }).addTo(zones);
}

const pairs = (numbers) =>
  Array.from({ length: numbers.length / 2 }, (_, i) => toScreen([numbers[2 * i] / 100, numbers[2 * i + 1] / 100]));

function drawView(view) {
  const pose = view.pose && { at: toScreen(view.pose), heading: view.pose[2] - frame.theta };
  overlay.show({
    pose,
    outline: now.outline,
    scan: pairs(view.scan),
    path: pairs(view.path),
    people: pairs(view.people),
    localisation: view.localisation,
  });
  if (following && pose) centre(false);
}

/** Centres the chair: always, or only once it leaves the middle part, so that the map rarely moves. */
function centre(always, zoom = map.getZoom()) {
  const at = toScreen(now.view.pose);
  const [size, spot] = [map.getSize(), map.latLngToContainerPoint(at)];
  const off = Math.abs(spot.x - size.x / 2) > EDGE * size.x || Math.abs(spot.y - size.y / 2) > EDGE * size.y;
  if (always || off) map.setView(at, zoom, { animate: !always && !STILL.matches, duration: 0.6 });
}

on("map", (message) => {
  meta = message;
  drawMap();
});
on("layout", () => meta && drawLayout());
on("view", (view) => drawView(view));
DARK.addEventListener("change", () => {
  overlay.readColours();
  drawMap();
});
new ResizeObserver(() => map.invalidateSize({ animate: false })).observe($("map"));

map.on("dragstart", () => follow(false));
map.on("click", ({ latlng }) => CLICKS.dispatchEvent(new CustomEvent("press", { detail: toMap(latlng) })));
$("map").addEventListener("keydown", ({ key }) => key.startsWith("Arrow") && follow(false));
$("zoom-in").addEventListener("click", () => map.zoomIn(1));
$("zoom-out").addEventListener("click", () => map.zoomOut(1));
$("follow").addEventListener("click", () => follow(!following));
