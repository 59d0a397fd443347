// Step guidance: the present movement, large, with an arrow, and spoken; the rider drives.

import { ask, on } from "./link.js";
import { recall, remember } from "./memory.js";
import { $, note, now, say, setText } from "./page.js";
import { soundWanted, speakOnly } from "./sound.js";

export const PROMPTS = ["no prompts", "at decisions", "also in time before", "the chair drives on request"];
const ARROWS = new Set(["left", "right", "turn round", "straight", "door", "back", "into the lift"]);

let level = Number(recall("guide-level") ?? 2);
let heard = null; // how many sentences had been spoken when the page last looked

const guide = (goal) => say(ask("guide", { goal, level }));

function show(view) {
  const guiding = view.guide;
  const begins = guiding && $("guide").hidden;
  $("guide").hidden = !guiding;
  if (begins) $("guide").scrollIntoView({ block: "nearest" });
  $("ask-guide").hidden = !view.waits || now.goals.length === 0;
  if (!guiding) {
    heard = null;
    return;
  }
  setText($("guide-title"), `On the way to ${guiding.goal}`);
  setText($("guide-text"), guiding.level > 0 || guiding.arrived ? guiding.sentence : "Drive as you like. Say it again tells the way.");
  setText($("guide-level"), `Prompts: ${PROMPTS[guiding.level]}`);
  const arrow = $("guide-arrow");
  arrow.toggleAttribute("hidden", guiding.level === 0 || !ARROWS.has(guiding.kind));
  arrow.style.transform = `rotate(${-Math.round((guiding.bearing * 180) / Math.PI)}deg)`;
  $("guide-drive").hidden = !guiding.offers || guiding.arrived;
  if (guiding.count > (heard ?? 0)) tell(guiding.said);
  heard = guiding.count;
}

/** Speaks a sentence, and shows it to screen readers where there is no voice. */
function tell(sentence) {
  if (!(soundWanted() && speakOnly(sentence, () => {}, true))) setText($("guide-said"), sentence);
}

on("view", show);
/** Guides to the goal that waits for a yes, in place of a drive there. */
export async function guideTo(goal) {
  await ask("cancel");
  return guide(goal);
}

/** Tells the present movement once more, at every level of prompting. */
export function sayAgain() {
  const { sentence } = now.view?.guide ?? {};
  if (!sentence) return;
  tell(sentence);
  note(sentence);
}

$("ask-guide").addEventListener("click", () => guideTo(now.view.goal));
$("guide-again").addEventListener("click", sayAgain);
/** Takes the next level of prompting, for the present goal and those to come. */
export async function nextLevel() {
  const guiding = now.view?.guide;
  if (!guiding) return;
  level = (guiding.level + 1) % PROMPTS.length;
  remember("guide-level", String(level));
  const { done, sentence } = await ask("guide", { goal: guiding.goal, level });
  if (!done) note(sentence, false);
}

/** Asks for a drive of the chair to the goal of guidance. */
export function letDrive() {
  const guiding = now.view?.guide;
  if (guiding) say(ask("go", { place: guiding.goal }));
}

$("guide-level").addEventListener("click", nextLevel);
$("guide-drive").addEventListener("click", letDrive);
$("guide-end").addEventListener("click", () => say(ask("end_guide")));
