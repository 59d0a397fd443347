// Stop: by pointer, by Enter on the button, by Esc and Space anywhere; over the socket and by fetch at once.

import { ask, post } from "./link.js";

const button = document.getElementById("stop");
const STOPPED = new EventTarget();

let takesSpace = () => false;

/** Whoever may need Space for something else: true keeps Stop from it (one-switch use, while the chair stands). */
export const onSpace = (handler) => (takesSpace = handler);

/** Whoever has to let go of something when Stop is pressed. */
export const onStop = (heard) => STOPPED.addEventListener("stop", heard);

export function stop() {
  ask("stop");
  post("stop").catch(() => {}); // its loss is said by the connection itself
  STOPPED.dispatchEvent(new Event("stop"));
  button.classList.remove("pressed");
  void button.offsetWidth; // so that the same animation begins anew
  button.classList.add("pressed");
}

export const isTextField = (element) =>
  element instanceof HTMLTextAreaElement ||
  (element instanceof HTMLInputElement && !["button", "checkbox", "radio", "submit"].includes(element.type));

button.addEventListener("pointerdown", stop);
button.addEventListener("click", (event) => {
  if (event.detail === 0) stop(); // by keyboard or by an assistive device, which press no pointer
});
function pressed(event) {
  if (isTextField(event.target) && event.key !== "Escape") return;
  if (event.key !== "Escape" && event.key !== " ") return;
  event.preventDefault(); // Space presses no other button, neither when it goes down nor when it comes up
  if (event.type === "keyup" || event.repeat) return;
  if (event.key === " " && takesSpace(event)) return;
  stop();
}

addEventListener("keydown", pressed, true);
addEventListener("keyup", pressed, true);
