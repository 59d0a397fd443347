// The menu: the whole page by one switch, two switches, joystick, keys or touch. One menu at a time, "Back" last and then Stop.

import { on } from "../link.js";
import { $, element, moves, now, setText } from "../page.js";
import { beep, speakOnly } from "../sound.js";
import { setScanning } from "../scan.js";
import { hold, letGo } from "../steer.js";
import { onSpace, onStop, stop } from "../stop.js";
import { showTab } from "../tabs.js";
import { Access, proposedSweep } from "./access.js";
import { startInputs } from "./inputs.js";
import { firstMenu } from "./items.js";
import { keep, options, SIZES } from "./options.js";

const TICK_MS = 20;
const PRESSES = 10; // of a calibration
const PAUSES_MS = [900, 1700, 1200, 2100, 1400]; // uneven, so that the rider cannot press by the beat
const SPEAKS_S = 4; // the frame waits at most so long for a voice

let open = options.own;
let trail = []; // menus from the first one: {title, make}, `make` gives the items anew
let shown = []; // items of the open menu
let situation = ""; // the chair's, as far as the first menu depends on it
let steers = false;
let measured = null; // the press times [s] of a calibration, null outside
let appeared = 0;
let speaksUntil = -Infinity;

const access = new Access(options.access);
const seconds = () => performance.now() / 1000;

const BACK = { label: "Back", act: () => void trail.pop(), kind: "back" };
const STOP = { label: "Stop", act: stop, kind: "stop" };

/** Whether switches are Stop and nothing else; joystick and keys have items beside Stop while the chair moves. */
const isStop = () => open && moves(now.view) && !steers && options.access.method !== "direct";

/** Shows the open menu; the frame begins at its first item. */
function show() {
  document.body.classList.toggle("by-menu", open);
  $("menu").hidden = !open;
  setText($("stop-keys"), open ? "the switch is Stop while the chair moves" : "or press Esc or Space");
  if (!open) return;
  $("menu").style.setProperty("--size", SIZES[options.size]);
  if (measured) {
    showTarget();
    return;
  }
  const menu = trail.length ? { title: trail.map(({ title }) => title).join(", "), items: inner() } : firstMenu(leave, calibrate);
  shown = menu.items;
  setText($("menu-title"), menu.title);
  $("menu-items").replaceChildren(...shown.map(drawn));
  access.begin(shown.length, seconds());
  framed();
}

/** The items of the open menu below the first one. A menu that has become empty, such as a removed wing's, has only "Back". */
const inner = () => [...trail.at(-1).make(), BACK, STOP];

function drawn(item) {
  const button = element("button", { type: "button", className: item.kind === "stop" ? "item stop-item" : "item" });
  button.append(element("b", { textContent: item.label, dir: "auto" }));
  if (item.detail) button.append(element("span", { textContent: item.detail, dir: "auto" }));
  if (item.hold) {
    button.addEventListener("pointerdown", () => steer(item));
    for (const kind of ["pointerup", "pointercancel", "pointerleave"]) button.addEventListener(kind, endSteering);
  } else if (item.kind !== "stop") {
    button.addEventListener("click", () => take(item));
  } else {
    button.addEventListener("pointerdown", stop);
    button.addEventListener("click", ({ detail }) => detail === 0 && stop()); // without a pointer
  }
  return element("li", {}, button);
}

/** Moves the frame to the item that access has chosen, and says it where the rider wishes. */
function framed() {
  const buttons = $("menu-items").querySelectorAll("button");
  for (const [index, button] of buttons.entries()) button.classList.toggle("scanned", index === access.index);
  const there = buttons[access.index];
  setText($("menu-rests"), access.index < 0 && options.access.method !== "inverse" ? "Press the switch to begin." : "");
  if (!there) return;
  if (access.index === 0) $("next").scrollIntoView({ block: "nearest" });
  there.scrollIntoView({ block: "nearest" });
  if (options.access.method === "direct" && $("menu").contains(document.activeElement)) there.focus();
  if (options.beeps) beep(access.index === 0 ? 880 : 560);
  if (options.spoken) speak(shown[access.index]);
}

function speak({ label, detail }) {
  speaksUntil = seconds() + SPEAKS_S;
  const ended = () => (speaksUntil = -Infinity);
  if (!speakOnly([label, detail].filter(Boolean).join(", "), ended)) ended();
}

/** Takes an item: opens its menu, steers, or does its work. */
function take(item) {
  if (item.hold) {
    steer(item);
    return;
  }
  if (item.items) {
    trail.push({ title: item.label, make: item.items });
  } else {
    const at = trail.length;
    const stays = item.act();
    if (stays !== true && item.kind !== "back" && at === trail.length) trail = [];
  }
  show();
}

function steer({ hold: [forward, turn] }) {
  steers = true;
  hold(forward, turn);
}

function endSteering() {
  if (!steers) return;
  steers = false;
  letGo();
  show();
}

function moved(steps) {
  for (const move of steps) {
    if (move === "take") {
      if (shown[access.index]) take(shown[access.index]);
    } else if (move === "back") {
      trail.pop();
      show();
    } else if (move === "stuck") {
      setText($("menu-said"), "The switch has been closed for ten seconds: it may be stuck. Stop is the large button, and Esc.");
    } else if (move === "chatter") {
      setText($("menu-said"), "The switch closes faster than any hand: check its plug. Its presses do not count until it rests.");
    } else {
      framed();
    }
  }
}

/** A switch's contact: number 1 or 2, closed or open. */
function switched(which, closed) {
  if (!open) return;
  if (closed) setText($("menu-said"), "");
  if (closed && (isStop() || steers)) {
    stop();
    access.ignore(which, seconds());
  } else if (closed && measured) {
    measure();
  } else {
    if (!closed) endSteering();
    moved(access.level(which, closed, seconds()));
  }
}

/** A step of a joystick, of keys or of a gamepad's stick; null where it is let go. */
function stepped(move) {
  if (!open) return;
  if (move === null) endSteering();
  else if (steers || isStop()) stop();
  else if (measured) measure();
  else moved(access.step(move, seconds()));
}

function leave() {
  open = options.own = false;
  keep();
  trail = [];
  show();
  showTab("options", "option-menu");
}

/** Measures the rider's presses: ten times a frame appears after an uneven pause, and the rider presses as soon as it is there. */
function calibrate() {
  measured = [];
  return true;
}

function showTarget() {
  setText($("menu-title"), "Press as soon as the frame appears");
  $("menu-items").replaceChildren(element("li", {}, element("p", { className: "target", id: "menu-target" })));
  nextTarget();
}

function nextTarget() {
  appeared = Infinity;
  $("menu-target").classList.remove("scanned");
  setText($("menu-said"), `${PRESSES - measured.length} more presses.`);
  setTimeout(() => {
    if (!measured) return;
    appeared = seconds();
    $("menu-target").classList.add("scanned");
  }, PAUSES_MS[measured.length % PAUSES_MS.length]);
}

function measure() {
  const late = seconds() - appeared;
  if (!(late > 0)) return; // a press before the frame was there tells nothing
  measured.push(late);
  if (measured.length < PRESSES) {
    nextTarget();
    return;
  }
  options.access.sweep = proposedSweep(measured);
  measured = null;
  keep();
  show();
  setText($("menu-said"), `Time per item is now ${options.access.sweep} s. Options, Times changes it.`);
}

function tick() {
  if (!open || measured) return;
  if (seconds() < speaksUntil) access.wait(seconds());
  if (!isStop()) moved(access.tick(seconds()));
}

/** The part of a view on which the first menu depends. */
const situationOf = (view) =>
  JSON.stringify([
    view.waits, view.countdown !== null, moves(view), view.paused, view.offers, view.asks, view.goal, view.guard?.level, view.guard?.capped,
    view.obstacles.some(({ reset }) => reset), view.guide && [view.guide.level, view.guide.offers, view.guide.arrived],
  ]);

on("view", (view) => {
  const next = situationOf(view);
  if (next === situation) return;
  situation = next;
  if (!open || steers || (measured && !moves(view))) return;
  [measured, trail] = [null, []];
  show();
});
onStop(() => {
  [steers, measured, trail] = [false, null, []];
  show();
});
$("menu").addEventListener("focusin", ({ target }) => {
  const index = [...$("menu-items").querySelectorAll("button")].indexOf(target);
  if (options.access.method !== "direct" || index < 0 || index === access.index) return;
  access.index = index;
  framed();
});
for (const kind of ["layout", "goals"]) on(kind, () => open && !measured && trail.length === 0 && show());

// with switches Space is the first one; with joystick, keys and touch it is Stop, as on the page
onSpace(() => open && options.access.method !== "direct", isStop);
startInputs({ isOpen: () => open, bySwitch: () => options.access.method !== "direct", switched, stepped });
setInterval(tick, TICK_MS);

$("option-menu").addEventListener("click", () => {
  setScanning(false);
  open = options.own = true;
  keep();
  show();
});
show();
