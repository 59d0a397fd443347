// The other chairs of the building: for which one this chair waits, why and for how long, and whether it goes first; in words
// and spoken.

import { on } from "./link.js";
import { $, element, sentenceOf, setText } from "./page.js";
import { soundWanted, speakOnly, warn } from "./sound.js";

const GOES_ON = "Goes on.";

let told = ""; // the wait that was spoken last
let first = ""; // why this chair goes before others, as spoken last
let tones = null; // those that were due so far; null before the first view

/** The wait with its time; the last seconds are not counted, as people walk as they like. */
function waitOf({ waits, seconds }) {
  if (!waits || seconds === null) return waits;
  const about = seconds > 5 ? `about ${5 * Math.round(seconds / 5)} s more` : "a few seconds more";
  return `${waits.replace(/[.:]\s*$/, "")}: ${about}.`;
}

function show({ others }) {
  $("others").hidden = !others;
  if (tones !== null && others?.tones > tones) warn();
  tones = others?.tones ?? null;
  if (!others) {
    told = first = "";
    return;
  }
  $("others-waits").hidden = !others.waits;
  setText($("others-waits"), waitOf(others));
  $("others-first").hidden = !others.first;
  $("others-first").dataset.lit = others.lit;
  setText($("others-first"), others.first);
  if (others.first && others.first !== first) tell(others.first);
  else if (others.waits !== told) tell(others.waits ? waitOf(others) : GOES_ON);
  told = others.waits;
  first = others.first;
  showChairs(others.chairs);
}

/** Speaks a sentence, and shows it to screen readers where there is no voice. */
function tell(sentence) {
  if (!(soundWanted() && speakOnly(sentence, () => {}))) setText($("others-said"), sentence);
}

function showChairs(chairs) {
  const list = $("others-list");
  const lines = chairs.map(({ number, told: said }) => `Chair ${number}: ${sentenceOf(said || "stands by")}`);
  if (list.dataset.shown === lines.join("\n")) return;
  list.dataset.shown = lines.join("\n");
  list.replaceChildren(...lines.map((textContent) => element("li", { textContent })));
}

on("view", show);
