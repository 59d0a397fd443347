// Stop: by pointer, by Enter on the button, by Esc anywhere, by Space but where one writes; over the socket and by fetch at
// once.

import { ask, post } from "./link.js";
import { note } from "./page.js";

const UNANSWERED_MS = 2000;

const button = document.getElementById("stop");
const STOPPED = new EventTarget();

let takesSpace = () => false;
let isSwitch = () => false;

/**
 * Whoever may need Space for something else: true keeps Stop from it (one-switch use, while the chair stands).
 * `stops`: whether Space is a rider's only way to Stop now, and so is Stop in text fields, too.
 */
export const onSpace = (handler, stops) => ([takesSpace, isSwitch] = [handler, stops]);

/** Whoever has to let go of something when Stop is pressed. */
export const onStop = (heard) => STOPPED.addEventListener("stop", heard);

export function stop() {
  heed([ask("stop"), post("stop").then((response) => response.json())]);
  STOPPED.dispatchEvent(new Event("stop"));
  button.classList.remove("pressed");
  void button.offsetWidth; // so that the same animation begins anew
  button.classList.add("pressed");
}

/** Says so where no way has brought Stop to the chair. */
async function heed(ways) {
  const done = ways.map(async (way) => (await way).done || Promise.reject());
  const late = new Promise((_, reject) => setTimeout(reject, UNANSWERED_MS));
  const unanswered = () => note("Stop was not answered: see whether the chair stands", false);
  await Promise.race([Promise.any(done), late]).catch(unanswered);
}

export const isTextField = (element) =>
  element instanceof HTMLTextAreaElement ||
  (element instanceof HTMLInputElement && !["button", "checkbox", "radio", "submit"].includes(element.type));

button.addEventListener("pointerdown", stop);
button.addEventListener("click", (event) => {
  if (event.detail === 0) stop(); // by keyboard or by an assistive device, which press no pointer
});
function pressed(event) {
  if (event.key !== "Escape" && event.key !== " ") return;
  if (event.key === " " && isTextField(event.target) && !isSwitch()) return;
  event.preventDefault(); // Space presses no other button, neither when it goes down nor when it comes up
  if (event.type === "keyup" || event.repeat) return;
  if (event.key === " " && takesSpace(event)) return;
  stop();
}

addEventListener("keydown", pressed, true);
addEventListener("keyup", pressed, true);
