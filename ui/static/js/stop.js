// Stop: by pointer, by Enter on the button, by Esc anywhere, by Space outside text fields. It is sent over the socket and
// by fetch at the same time.

import { ask, post } from "./link.js";
import { note } from "./page.js";

const UNANSWERED_MS = 2000;

const button = document.getElementById("stop");
const STOPPED = new EventTarget();

let takesSpace = () => false;
let isSwitch = () => false;

/**
 * Registers the one-switch mode. `handler`: true where it has used the press of Space, which then is not Stop.
 * `stops`: whether Space has to be Stop in text fields, too.
 */
export const onSpace = (handler, stops) => ([takesSpace, isSwitch] = [handler, stops]);

/** Registers a listener for Stop. */
export const onStop = (heard) => STOPPED.addEventListener("stop", heard);

export function stop() {
  heed([ask("stop"), post("stop").then((response) => response.json())]);
  STOPPED.dispatchEvent(new Event("stop"));
  button.classList.remove("pressed");
  void button.offsetWidth; // restarts the animation
  button.classList.add("pressed");
}

/** Warns if neither path has brought an answer to Stop. */
async function heed(ways) {
  const done = ways.map(async (way) => (await way).done || Promise.reject());
  const late = new Promise((_, reject) => setTimeout(reject, UNANSWERED_MS));
  const unanswered = () => note("No answer to Stop: check that the chair stands", false);
  await Promise.race([Promise.any(done), late]).catch(unanswered);
}

export const isTextField = (element) =>
  element instanceof HTMLTextAreaElement ||
  (element instanceof HTMLInputElement && !["button", "checkbox", "radio", "submit"].includes(element.type));

button.addEventListener("pointerdown", stop);
button.addEventListener("click", (event) => {
  if (event.detail === 0) stop(); // by keyboard or an assistive device, without a pointer
});
function pressed(event) {
  if (event.key !== "Escape" && event.key !== " ") return;
  if (event.key === " " && isTextField(event.target) && !isSwitch()) return;
  event.preventDefault(); // so that Space presses no button, neither on keydown nor on keyup
  if (event.type === "keyup" || event.repeat) return;
  if (event.key === " " && takesSpace(event)) return;
  stop();
}

addEventListener("keydown", pressed, true);
addEventListener("keyup", pressed, true);
