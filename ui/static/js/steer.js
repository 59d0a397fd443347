// The page's joystick: its position is sent ten times a second while it is held, and a release at once when it is let go.
// Another window, another tab, a lost connection and Stop release it, too.

import { ask, linkState, on } from "./link.js";
import { $, setText } from "./page.js";
import { onStop } from "./stop.js";
import { onTab } from "./tabs.js";

const TELL_MS = 100;
const KEYS = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowLeft: [0, 1], ArrowRight: [0, -1] };

const pad = $("stick");
const knob = pad.firstElementChild;
const keys = new Map();
let wish = null; // [forward, turn] while held
let timer = 0;

export function hold(forward, turn) {
  wish = [clamp(forward), clamp(turn)];
  knob.style.transform = `translate(${-wish[1] * 38}%, ${-wish[0] * 38}%) translate(-50%, -50%)`;
  pad.classList.add("held");
  if (!timer) {
    ask("release"); // begins a new hold, however the last one ended
    timer = setInterval(tell, TELL_MS);
    tell();
  }
}

export function letGo() {
  if (!wish && !timer) return;
  clearInterval(timer);
  timer = 0;
  wish = null;
  keys.clear();
  knob.style.transform = "";
  pad.classList.remove("held");
  ask("release");
}

const clamp = (value) => Math.max(-1, Math.min(1, value));

async function tell() {
  if (linkState() !== "open" || document.visibilityState !== "visible") {
    letGo();
    return;
  }
  const { done, sentence } = await ask("steer", { forward: wish[0], turn: wish[1] });
  setText($("steer-said"), done ? "" : sentence);
}

function drag(event) {
  const box = pad.getBoundingClientRect();
  const [x, y] = [event.clientX - box.left - box.width / 2, event.clientY - box.top - box.height / 2];
  const reach = 0.38 * box.width;
  const length = Math.max(1, Math.hypot(x, y) / reach);
  hold(-y / reach / length, -x / reach / length);
}

pad.addEventListener("pointerdown", (event) => {
  pad.setPointerCapture(event.pointerId);
  drag(event);
});
pad.addEventListener("pointermove", (event) => wish && pad.hasPointerCapture(event.pointerId) && drag(event));
for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) pad.addEventListener(kind, letGo);

$("steer").addEventListener("keydown", (event) => {
  if (!(event.key in KEYS)) return;
  event.preventDefault();
  keys.set(event.key, KEYS[event.key]);
  byKeys();
});
$("steer").addEventListener("keyup", ({ key }) => {
  if (keys.delete(key)) byKeys();
});

function byKeys() {
  if (keys.size === 0) {
    letGo();
    return;
  }
  const sum = [...keys.values()].reduce(([f, t], [forward, turn]) => [f + forward, t + turn], [0, 0]);
  hold(...sum);
}

for (const button of document.querySelectorAll("[data-hold]")) {
  const ways = button.dataset.hold.split(",").map(Number);
  button.addEventListener("pointerdown", (event) => {
    button.setPointerCapture(event.pointerId);
    hold(...ways);
  });
  for (const kind of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) button.addEventListener(kind, letGo);
  button.addEventListener("keydown", ({ key }) => key === "Enter" && hold(...ways));
  button.addEventListener("keyup", ({ key }) => key === "Enter" && letGo());
  button.addEventListener("contextmenu", (event) => event.preventDefault());
}

pad.addEventListener("blur", letGo);
addEventListener("blur", letGo);
addEventListener("pagehide", letGo);
document.addEventListener("visibilitychange", letGo);
on("state", (state) => state !== "open" && letGo());
onStop(letGo);
onTab((tab) => tab !== "steer" && letGo());
