// Keeps the keyboard's focus on the page. Where the control that has it is hidden, disabled or removed, the focus goes to the
// successor that `data-next` names, else back to the latest control that is still there, else to the sentence about the chair.

import { $ } from "./page.js";

const REMEMBERED = 20;

const trail = []; // controls that had the focus, the latest last
let byPointer = false;

const isUsable = (target) => target !== null && target.isConnected && !target.disabled && target.getClientRects().length > 0;

function keep() {
  const lost = trail.at(-1);
  if (!lost || isUsable(lost) || ![document.body, lost].includes(document.activeElement)) return;
  const next = lost.closest("[data-next]");
  const places = [next && $(next.dataset.next), ...[...trail].reverse(), $("next")];
  // without scrolling for pointers: their users look at something else
  places.find(isUsable)?.focus({ preventScroll: byPointer });
}

addEventListener("focusin", ({ target }) => {
  trail.push(target);
  if (trail.length > REMEMBERED) trail.shift();
});
addEventListener("pointerdown", () => (byPointer = true), true);
addEventListener("keydown", () => (byPointer = false), true);
new MutationObserver(keep).observe(document.body, {
  subtree: true,
  childList: true,
  attributes: true,
  attributeFilter: ["hidden", "disabled"],
});
