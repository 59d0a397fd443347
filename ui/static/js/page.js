// Helpers of the other modules: elements, notes, sentences, and the newest messages.

import { on } from "./link.js";
import { showNote } from "./stop.js";

export const $ = (id) => document.getElementById(id);

/** Creates an element with properties and children. */
export function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

const NOTE_MS = 8000;

/** Shows a short note that disappears by itself; bad ones stay longer. */
export function note(sentence, good = true) {
  if (!sentence) return;
  showNote(sentenceOf(sentence), good ? "note" : "note bad", good ? NOTE_MS : 2 * NOTE_MS);
}

/** Shows the answer to a command as a note; resolves to whether it was done. */
export async function say(answering) {
  const { done, sentence } = await answering;
  note(sentence, done);
  return done;
}

/** Text as a sentence, with a capital letter and a full stop. */
export function sentenceOf(text) {
  const trimmed = text.trim();
  if (!trimmed) return "";
  const begun = trimmed[0].toUpperCase() + trimmed.slice(1);
  return /[.!?]$/.test(begun) ? begun : `${begun}.`;
}

/** The first free name: the word with a number. */
export function freeName(word, things) {
  const names = new Set(things.map(({ name }) => name));
  for (let number = 1; ; number += 1) if (!names.has(`${word} ${number}`)) return `${word} ${number}`;
}

/** Sets text only where it changes, so that screen readers read nothing twice. */
export function setText(target, text) {
  if (target.textContent !== text) target.textContent = text;
}

export const moves = (view) =>
  view !== null &&
  (view.countdown !== null ||
    (view.mode === "autonomous" && !view.paused) ||
    view.mode === "assisted" ||
    Math.abs(view.twist[0]) > 0.02 ||
    Math.abs(view.twist[1]) > 0.03);

/** The newest view, the one before it, what a rider who cannot see is told (null without), the layout, the goals of the building, and the chair's footprint. */
export const now = { goals: [], haptics: null, view: null, before: null, layout: { places: [], zones: [], undoable: false }, outline: [] };

// this module registers first, so that other listeners find the newest view here
on("view", (view) => ([now.before, now.view] = [now.view, view]));
on("layout", (layout) => (now.layout = layout));
on("goals", ({ goals }) => (now.goals = goals));
on("chair", ({ outline }) => (now.outline = outline));
