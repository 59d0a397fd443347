// One-switch scanning: a frame walks through groups of buttons, then through the buttons of the chosen group. The switch
// is Space or Enter; while the chair moves it is Stop and nothing else, wherever the focus is.

import { recall, remember } from "./memory.js";
import { $, moves, now, setText } from "./page.js";
import { onSpace, stop } from "./stop.js";

const BOUNCE_MS = 250;
const HELPED_MS = 10_000; // a text field without other input for so long is left
const ROUNDS = 2; // rounds through a group's buttons before the frame returns to the groups

const option = $("option-scanning");
const interval = $("option-interval");

let running = recall("scanning") === "on";
let timer = 0;
let group = null; // name of the chosen group
let index = -1;
let rounds = 0;
let marked = [];
let pressedAt = -Infinity;
let helpedAt = -Infinity; // time of the latest input other than the switch
let releases = null;

const usable = (target) => !target.disabled && target.offsetParent !== null;
const groupOf = (target) => target.closest("[data-scan-group]")?.dataset.scanGroup ?? "";

/** Groups of buttons on the page by name; a button without a group is a group of its own. */
function groups() {
  const found = new Map();
  for (const target of document.querySelectorAll("[data-scan]")) {
    if (!usable(target)) continue;
    const name = groupOf(target) || target.textContent.trim();
    found.set(name, [...(found.get(name) ?? []), target]);
  }
  return found;
}

/** The stops of the frame: [name, targets] each, Stop first. */
function stations() {
  const all = groups();
  if (group && all.has(group)) return all.get(group).map((target) => [labelOf(target), [target]]);
  group = null;
  return [["Stop", [$("stop")]], ...all];
}

const labelOf = (target) => target.getAttribute("aria-label") ?? target.textContent.trim();

function mark(targets) {
  for (const target of marked) target.classList.remove("scanned");
  marked = targets;
  for (const target of marked) target.classList.add("scanned");
  marked[0]?.scrollIntoView({ block: "nearest" });
}

function step() {
  leaveField();
  if (moves(now.view)) {
    [group, index, rounds] = [null, -1, 0];
    mark([$("stop")]);
    return;
  }
  const all = stations();
  index += 1;
  if (index >= all.length) {
    [index, rounds] = [0, rounds + 1];
    if (group && rounds >= ROUNDS) {
      [group, index, rounds] = [null, -1, 0];
      step();
      return;
    }
  }
  mark(all[Math.min(index, all.length - 1)][1]);
}

/** Handles a press of the switch: takes the group or button in the frame. */
function press() {
  const at = performance.now();
  if (at - pressedAt < BOUNCE_MS && !moves(now.view)) return;
  pressedAt = at;
  helpedAt = -Infinity;
  if (moves(now.view) || marked[0] === $("stop")) {
    stop();
    return;
  }
  if (marked.length > 1) {
    [group, index, rounds] = [groupOf(marked[0]), -1, 0];
  } else if (marked[0]?.isConnected) {
    take(marked[0]);
  }
  restart();
}

function take(target) {
  [group, index, rounds] = [null, -1, 0];
  if (target.dataset.hold) {
    target.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter" }));
    releases = target; // steering lasts as long as the switch is held
  } else {
    target.click();
  }
}

function restart() {
  clearInterval(timer);
  if (!running) {
    mark([]);
    return;
  }
  timer = setInterval(step, Number(interval.value));
  step();
}

/** Switches the scanning of the page on or off. */
export function setScanning(on) {
  running = on;
  [group, index, rounds] = [null, -1, 0];
  remember("scanning", on ? "on" : "off");
  option.setAttribute("aria-pressed", String(on));
  document.body.classList.toggle("scanning", on);
  setText($("stop-keys"), on ? "the switch is Stop while the chair moves" : "or press Esc or Space");
  restart();
}

const WRITES = "input, select, textarea";

/** Whether a press of the switch is Stop. */
const stops = () => running && moves(now.view);

onSpace(() => {
  if (!running) return false;
  press();
  return true;
}, stops);

/** Leaves a text field in which nobody types: one switch alone could not get out of it. */
function leaveField() {
  const field = document.activeElement;
  if (running && field?.matches(WRITES) && performance.now() - helpedAt > HELPED_MS) field.blur();
}

function helped({ isTrusted, key }) {
  if (isTrusted && key !== " " && key !== "Enter") helpedAt = performance.now();
}

addEventListener("focusin", leaveField);
addEventListener("pointerdown", helped, true);
addEventListener("keydown", helped, true);

addEventListener(
  "keydown",
  (event) => {
    if (!running || event.key !== "Enter" || !event.isTrusted) return;
    if (event.target.matches(WRITES) && !stops()) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (!event.repeat) press();
  },
  true,
);
addEventListener(
  "keyup",
  ({ key, isTrusted }) => {
    if (!releases || !isTrusted || (key !== "Enter" && key !== " ")) return;
    releases.dispatchEvent(new KeyboardEvent("keyup", { key: "Enter" }));
    releases = null;
  },
  true,
);

const kept = recall("interval");
if ([...interval.options].some(({ value }) => value === kept)) interval.value = kept;
interval.addEventListener("change", () => {
  remember("interval", interval.value);
  restart();
});
option.addEventListener("click", () => setScanning(!running));
setScanning(running);
