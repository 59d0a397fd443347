// Levels of help while the rider drives: inform, guard, guide, each by a press; the guard's caps; and its override.

import { ask, on } from "./link.js";
import { $, element, note, now, setText } from "./page.js";
import { soundWanted, speakOnly } from "./sound.js";

export const LEVELS = ["inform", "guard", "guide"];
const DIRECTIONS = ["Ahead", "Back", "Left", "Right"];

let heard = null; // the sentence about the level when the page last looked

/** Takes a level by a press; the chair's sentence about it is told by the next view. */
export async function chooseLevel(level) {
  const { done, sentence } = await ask("level", { level });
  if (!done) note(sentence, false);
}

/** Lets the rider creep against the guard. */
export async function override() {
  const { done, sentence } = await ask("override");
  if (!done) note(sentence, false);
}

function show({ guard }) {
  $("help-levels").hidden = !guard;
  $("help-now").hidden = !guard || guard.level === "inform";
  if (!guard) return;
  for (const level of LEVELS) $(`help-${level}`).setAttribute("aria-pressed", String(level === guard.level));
  setText($("help-state"), state(guard));
  for (const id of ["help-caps", "haptics-caps"]) showCaps($(id), guard.caps);
  $("help-override").hidden = !guard.capped || guard.creeps || guard.lost;
  if (heard !== null && guard.told && guard.told !== heard) tell(guard.told);
  heard = guard.told;
}

/** What the guard does now, in a few words. */
function state({ waits, lost, creeps, warns, capped }) {
  if (waits) return "Let go of the joystick for two seconds; then the guard begins.";
  if (lost) return "The computer is lost. The chair is slow until you let go of the joystick for two seconds.";
  if (warns) return "You are about to creep against the guard.";
  if (creeps) return "You may creep against the guard.";
  return capped ? "The guard holds you back." : "The guard watches. It does not see everything.";
}

/** Shows the caps in a list: beside the levels of help, and on the tab of touch. */
function showCaps(list, caps) {
  list.hidden = !caps;
  const texts = (caps ?? []).map((cap, to) => `${DIRECTIONS[to]} ${Math.round(100 * cap)} %`);
  if (list.dataset.shown === texts.join()) return;
  list.dataset.shown = texts.join();
  list.replaceChildren(...texts.map((textContent) => element("li", { className: "fact", textContent })));
}

/** Speaks a sentence, unless the chair itself does, and shows it to screen readers where there is no voice. */
function tell(sentence) {
  note(sentence);
  if (now.haptics) return;
  if (!(soundWanted() && speakOnly(sentence, () => {}))) setText($("help-said"), sentence);
}

on("view", show);
for (const level of LEVELS) $(`help-${level}`).addEventListener("click", () => chooseLevel(level));
$("help-override").addEventListener("click", override);
