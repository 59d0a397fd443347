// The engineers' panel: figures by kind, and the camera's picture, which is loaded only while the panel is open.

import { on, picture } from "./link.js";
import { $, element } from "./page.js";

const PICTURE_MS = 250;
const FIGURES_MS = 500;
const KINDS = [["Times", /^(m?s|ms CPU)$/], ["Rates", /^Hz$/], ["Memory", /^[kMG]?B$/], ["Volts", /^V$/], ["Other", /^/]];

let open = false;
let shownAt = -Infinity;
let url = null;

/** Splits a name such as "tick, mean [ms]" into label and unit, and finds the kind of figure. */
function parts(name) {
  const [, label, unit = ""] = /^(.*?)(?: \[(.*)\])?$/.exec(name);
  return { label, unit, kind: KINDS.find(([, units]) => units.test(unit))[0] };
}

const shown = (value) => (value === null ? "-" : value.toFixed(Number.isInteger(value) || Math.abs(value) >= 100 ? 0 : 2));

function table(kind, rows) {
  const body = element("tbody");
  for (const { label, unit, value } of rows) {
    const head = element("th", { scope: "row", textContent: label });
    body.append(element("tr", {}, head, element("td", { textContent: `${shown(value)} ${unit}` })));
  }
  return element("table", {}, element("caption", { textContent: kind }), body);
}

function show(panel) {
  const rows = Object.entries(panel).map(([name, value]) => ({ ...parts(name), value }));
  const tables = KINDS.map(([kind]) => [kind, rows.filter((row) => row.kind === kind)]).filter(([, found]) => found.length);
  $("figures").replaceChildren(
    ...(tables.length ? tables.map(([kind, found]) => table(kind, found)) : [element("p", { textContent: "No figures." })]),
  );
}

async function look() {
  if (!open) return;
  const newest = document.visibilityState === "visible" ? await picture("api/picture.jpg").catch(() => null) : url;
  if (newest !== url) {
    if (url) URL.revokeObjectURL(url);
    url = newest;
    if (url) $("picture").src = url;
    $("camera").hidden = !url;
  }
  setTimeout(look, PICTURE_MS);
}

on("view", ({ panel }) => {
  if (!open || performance.now() - shownAt < FIGURES_MS) return;
  shownAt = performance.now();
  show(panel);
});
$("panel-open").addEventListener("click", () => {
  open = !open;
  $("panel").hidden = !open;
  $("panel-open").setAttribute("aria-expanded", String(open));
  shownAt = -Infinity;
  if (open) look();
});
