// The building mode's entry point: buttons, keys, sentences.

import {
  addNode, deleteSelected, joinAtCross, mark, moveCross, moveToCross, selectAtCross, setCorner, step, toggleChain,
} from "./actions.js";
import { findMaps } from "./build_panel.js";
import { fit, onPress, zoom } from "./canvas.js";
import { element } from "./forms.js";
import { load, model, on, post, say, useToken } from "./model.js";
import { save, showTab } from "./panels.js";
import { onShown, shown, select, showAgain } from "./state.js";
import "./switching.js";

const $ = (id) => document.getElementById(id);
const FAR = 4; // times a step, with Shift
const SAID_MS = 12_000;
let saidTimer = 0;

on("said", ({ sentence, good }) => {
  $("said").textContent = sentence.charAt(0).toUpperCase() + sentence.slice(1);
  $("said").classList.toggle("bad", !good);
  clearTimeout(saidTimer);
  saidTimer = setTimeout(() => ($("said").textContent = ""), SAID_MS);
});

on("token", () => {
  $("door").hidden = false;
  $("door-token").focus();
});
$("door").addEventListener("submit", (event) => {
  event.preventDefault();
  useToken($("door-token").value);
  $("door").hidden = true;
  begin();
});

on("change", () => {
  $("title").textContent = model.name;
  document.title = `${model.name} - Waychair`;
  const errors = model.findings.filter(({ severity }) => severity === "error").length;
  const faults = `${errors} errors, ${model.findings.length - errors} warnings`;
  $("state").textContent = `${model.saved ? "Saved" : "Draft, not saved"}; ${faults}`;
  $("undo").disabled = !model.undoes;
  $("redo").disabled = !model.redoes;
  $("undo").title = model.undoes && `Undo: ${model.undoes}`;
  $("redo").title = model.redoes && `Do again: ${model.redoes}`;
  $("foreign").hidden = !model.foreign.length;
  $("foreign-list").replaceChildren(...model.foreign.map((sentence) => element("li", { textContent: sentence })));
  const chosen = $("storey");
  chosen.replaceChildren(...model.storeys.map(({ id, name }) => element("option", { value: id, textContent: name || id })));
  chosen.value = shown.storey;
  chosen.disabled = !model.storeys.length;
  showAgain();
});

onShown(() => {
  $("storey").value = shown.storey;
  const [x, y] = shown.cross;
  $("cross-said").textContent = `Cross at x ${x.toFixed(2)}, y ${y.toFixed(2)} m. ${shown.selected ? `Selected: ${shown.selected.ref || "the building"}.` : "Nothing selected."}`;
  $("chain").setAttribute("aria-pressed", String(shown.chain));
});

$("storey").addEventListener("change", () => select("storey", $("storey").value));
$("undo").addEventListener("click", () => undo());
$("redo").addEventListener("click", () => redo());
$("save").addEventListener("click", save);
$("take-files").addEventListener("click", () => post("take_files"));
$("save-over").addEventListener("click", () => post("save", { over: true }));

async function undo() {
  const what = model.undoes;
  if ((await post("undo")).done && what) say(`Undone: ${what}.`);
}

async function redo() {
  const what = model.redoes;
  if ((await post("redo")).done && what) say(`Done again: ${what}.`);
}

const AT_CROSS = {
  "at-select": () => {
    selectAtCross();
    showTab("selected");
  },
  "at-add": () => addNode(),
  "at-join": joinAtCross,
  "at-move": moveToCross,
  "at-delete": deleteSelected,
  "at-mark": mark,
  "at-corner": setCorner,
  chain: toggleChain,
};
for (const id in AT_CROSS) $(id).addEventListener("click", AT_CROSS[id]);

const stepLength = () => Number($("step").value);
for (const button of document.querySelectorAll("[data-cross]")) {
  const [right, up] = button.dataset.cross.split(",").map(Number);
  button.addEventListener("click", () => moveCross(right * stepLength(), up * stepLength()));
}
$("zoom-in").addEventListener("click", () => zoom(1.4, shown.cross));
$("zoom-out").addEventListener("click", () => zoom(1 / 1.4, shown.cross));
$("fit").addEventListener("click", fit);

onPress(() => {
  if (shown.chain) addNode();
  else AT_CROSS["at-select"]();
});

const ARROWS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };
const KEYS = {
  Enter: AT_CROSS["at-select"],
  n: () => addNode(),
  j: joinAtCross,
  m: moveToCross,
  Delete: deleteSelected,
  Backspace: deleteSelected,
  x: mark,
  c: setCorner,
  ".": () => step(1),
  ",": () => step(-1),
  "+": () => zoom(1.4, shown.cross),
  "-": () => zoom(1 / 1.4, shown.cross),
};

$("canvas").addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const times = stepLength() * (event.shiftKey ? FAR : 1);
  if (event.key in ARROWS) moveCross(ARROWS[event.key][0] * times, ARROWS[event.key][1] * times);
  else if (KEYS[event.key]) KEYS[event.key]();
  else return;
  event.preventDefault();
});

addEventListener("keydown", (event) => {
  if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
  const key = event.key.toLowerCase();
  const inField = event.target.matches("input[type=text]");
  if (key === "s") save();
  else if (key === "z" && !inField) (event.shiftKey ? redo : undo)();
  else if (key === "y" && !inField) redo();
  else return;
  event.preventDefault();
});

async function begin() {
  if (!(await load())) return;
  if (model.chair) {
    $("stop-bar").hidden = false;
    await import("../stop.js");
  }
  await findMaps();
  if (!model.storeys.length) $("build").querySelector("select, input")?.focus();
}

begin();
