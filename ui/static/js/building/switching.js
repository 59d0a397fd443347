// One switch: a frame walks through groups of controls, then through those of the chosen group; Space or Enter takes what is
// in the frame. A text field in the frame opens a pad of letters, a list steps to its next choice.

import { element } from "./forms.js";
import { say } from "./model.js";

const $ = (id) => document.getElementById(id);
const KEPT = "building-switch";
const BOUNCE_MS = 250;
const ROUNDS = 2; // rounds through a group before the frame returns to the groups
const INTERVALS = [0.7, 1, 1.5, 2.5, 4]; // seconds for each item
const ROWS = ["abcdefg", "hijklmn", "opqrstu", "vwxyz -", "0123456", "789.,/:"];

let [running, interval] = recalled();
let timer = 0;
let group = null;
let index = -1;
let rounds = 0;
let marked = [];
let pressedAt = -Infinity;
let field = null; // text field into which the pad writes

function recalled() {
  try {
    const kept = JSON.parse(localStorage.getItem(KEPT)) ?? {};
    return [kept.running === true, INTERVALS.includes(kept.interval) ? kept.interval : 1.5];
  } catch {
    return [false, 1.5];
  }
}

function keep() {
  try {
    localStorage.setItem(KEPT, JSON.stringify({ running, interval }));
  } catch {
    // the setting lasts until the page is left
  }
}

const usable = (target) => !target.disabled && target.getClientRects().length > 0;
const groupOf = (target) => target.closest("[data-scan-group]")?.dataset.scanGroup ?? target.textContent.trim();

function groups() {
  const found = new Map();
  const root = field ? $("pad") : document;
  for (const target of root.querySelectorAll("[data-scan]")) {
    if (!usable(target)) continue;
    const name = groupOf(target);
    found.set(name, [...(found.get(name) ?? []), target]);
  }
  return found;
}

function mark(targets) {
  for (const target of marked) target.classList.remove("scanned");
  marked = targets;
  for (const target of marked) target.classList.add("scanned");
  marked[0]?.scrollIntoView({ block: "nearest" });
}

function step() {
  const all = groups();
  const stations = group && all.has(group) ? all.get(group).map((target) => [target]) : [...all.values()];
  if (!all.has(group)) group = null;
  index += 1;
  if (index >= stations.length) {
    [index, rounds] = [0, rounds + 1];
    if (group && rounds >= ROUNDS) [group, index, rounds] = [null, -1, 0];
  }
  mark(stations[Math.max(index, 0)] ?? []);
}

function press() {
  const at = performance.now();
  if (at - pressedAt < BOUNCE_MS) return;
  pressedAt = at;
  if (marked.length > 1) [group, index, rounds] = [groupOf(marked[0]), -1, 0];
  else if (marked[0]?.isConnected) take(marked[0]);
  restart();
}

function take(target) {
  if (!field) [group, index, rounds] = [null, -1, 0];
  if (target instanceof HTMLSelectElement) {
    [group, index, rounds] = [groupOf(target), groups().get(groupOf(target)).indexOf(target) - 1, 0]; // the frame stays here
    target.selectedIndex = (target.selectedIndex + 1) % target.options.length;
    target.dispatchEvent(new Event("change"));
  } else if (target instanceof HTMLInputElement && target.type === "text") openPad(target);
  else {
    target.focus();
    target.click();
  }
}

function openPad(target) {
  field = target;
  const pad = $("pad");
  const key = (label, write) => {
    const button = element("button", { type: "button", textContent: label, data: { scan: "" } });
    button.addEventListener("click", write);
    return button;
  };
  const typed = (letter) => () => {
    field.value += letter;
    $("pad-text").textContent = field.value || "empty";
    [group, index, rounds] = [null, -1, 0];
  };
  const rows = ROWS.map((letters) => element("div", { className: "row", data: { scanGroup: `Letters ${letters}` } }, ...[...letters].map((letter) => key(letter === " " ? "space" : letter, typed(letter)))));
  const last = element("div", { className: "row", data: { scanGroup: "Text" } },
    key("Done", closePad),
    key("Capital", () => {
      field.value = field.value.charAt(0).toUpperCase() + field.value.slice(1);
      $("pad-text").textContent = field.value;
    }),
    key("Back", () => {
      field.value = field.value.slice(0, -1);
      $("pad-text").textContent = field.value || "empty";
    }),
    key("Empty", () => {
      field.value = "";
      $("pad-text").textContent = "empty";
    }));
  pad.replaceChildren(element("p", { id: "pad-text", textContent: field.value || "empty" }), last, ...rows);
  pad.hidden = false;
  [group, index, rounds] = [null, -1, 0];
}

function closePad() {
  $("pad").hidden = true;
  field?.dispatchEvent(new Event("change"));
  field = null;
  [group, index, rounds] = [null, -1, 0];
}

function restart() {
  clearInterval(timer);
  document.body.classList.toggle("scanning", running);
  if (!running) {
    mark([]);
    return;
  }
  timer = setInterval(step, 1000 * interval);
  step();
}

/** Switches scanning on or off. */
export function setScanning(on) {
  running = on;
  [group, index, rounds] = [null, -1, 0];
  $("switch").setAttribute("aria-pressed", String(on));
  if (!on && field) closePad();
  keep();
  restart();
}

function pressed(event) {
  if (!running || !event.isTrusted || (event.key !== " " && event.key !== "Enter")) return;
  event.preventDefault();
  event.stopImmediatePropagation();
  if (event.type === "keydown" && !event.repeat) press();
}

addEventListener("keydown", pressed, true);
addEventListener("keyup", pressed, true);
$("switch").addEventListener("click", () => setScanning(!running));
$("switch-time").addEventListener("click", () => {
  interval = INTERVALS[(INTERVALS.indexOf(interval) + 1) % INTERVALS.length];
  say(`${interval} s for each item.`);
  keep();
  restart();
});
if (running) setScanning(true);
