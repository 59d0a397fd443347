// The rider's inputs: keys, a gamepad or a switch box that is one, and switches of the chair itself.

import { on } from "../link.js";

const POLL_MS = 20;
const SWITCHES = { " ": 1, Enter: 2 }; // as switch boxes that are keyboards send them
const STEPS = { ArrowDown: "next", ArrowUp: "previous", ArrowRight: "take", ArrowLeft: "back" };
const PUSHED = 0.6; // share of a gamepad's travel from which it counts as a step
const CENTRED = 0.3;

const isText = (target) => target instanceof Element && target.matches("input, select, textarea");

/** Whether Enter is a switch: not on a button outside the menu, which it presses. */
const isForMenu = ({ target }) => !target.closest?.("button, a") || target.closest("#menu") !== null;

/**
 * Begins to listen. `switched(number, closed)` and `stepped(move)` are called while `isOpen()`; the end of a step is null.
 * Space is a switch while `bySwitch()`, and else Stop.
 */
export function startInputs({ isOpen, bySwitch, switched, stepped }) {
  for (const [kind, closed] of [["keydown", true], ["keyup", false]]) {
    addEventListener(
      kind,
      (event) => {
        if (!isOpen() || !event.isTrusted || isText(event.target)) return;
        const isSwitch = event.key === " " ? bySwitch() : isForMenu(event);
        const which = isSwitch ? SWITCHES[event.key] : 0;
        const move = STEPS[event.key];
        if (!which && (!move || event.target.closest?.(".map"))) return;
        event.preventDefault();
        event.stopImmediatePropagation();
        if (event.repeat) return;
        if (which) switched(which, closed);
        else stepped(closed ? move : null);
      },
      true,
    );
  }
  addEventListener("blur", () => {
    for (const which of [1, 2]) switched(which, false); // keys that are let go elsewhere
  });
  on("switch", ({ number, closed }) => switched(number, closed));

  const before = { buttons: [false, false], centred: true };
  setInterval(() => {
    if (!isOpen()) return;
    for (const pad of navigator.getGamepads?.() ?? []) if (pad?.connected) polled(pad, before, switched, stepped);
  }, POLL_MS);
}

/** The changes of a gamepad since the last poll: its first two buttons are the switches, its stick steps. */
function polled(pad, before, switched, stepped) {
  for (const index of [0, 1]) {
    const closed = pad.buttons[index]?.pressed ?? false;
    if (closed === before.buttons[index]) continue;
    before.buttons[index] = closed;
    switched(index + 1, closed);
  }
  const [x = 0, y = 0] = pad.axes;
  const far = Math.max(Math.abs(x), Math.abs(y));
  if (far < CENTRED && !before.centred) {
    before.centred = true;
    stepped(null);
  }
  if (far < PUSHED || !before.centred) return;
  before.centred = false;
  if (Math.abs(y) > Math.abs(x)) stepped(y > 0 ? "next" : "previous");
  else stepped(x > 0 ? "take" : "back");
}
