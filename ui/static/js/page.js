// What the other modules share: elements, notes, and how numbers are said.

import { on } from "./link.js";

export const $ = (id) => document.getElementById(id);

/** An element with properties and children. */
export function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

const NOTE_MS = 8000;

/** A short note that goes away by itself; bad ones stay a little longer. */
export function note(sentence, good = true) {
  if (!sentence) return;
  const text = sentenceOf(sentence);
  for (const other of $("notes").children) if (other.textContent === text) other.remove();
  const made = element("p", { className: good ? "note" : "note bad", textContent: text });
  $("notes").append(made);
  setTimeout(() => made.remove(), good ? NOTE_MS : 2 * NOTE_MS);
}

/** Says what came of something that was asked. */
export async function say(answering) {
  const { done, sentence } = await answering;
  note(sentence, done);
  return done;
}

/** Text as a sentence: a capital, and a full stop. */
export function sentenceOf(text) {
  const trimmed = text.trim();
  if (!trimmed) return "";
  const begun = trimmed[0].toUpperCase() + trimmed.slice(1);
  return /[.!?]$/.test(begun) ? begun : `${begun}.`;
}

/** A name that none of these has yet. */
export function freeName(word, things) {
  const names = new Set(things.map(({ name }) => name));
  for (let number = 1; ; number += 1) if (!names.has(`${word} ${number}`)) return `${word} ${number}`;
}

/** Sets text only where it changes, so that nothing is read out twice. */
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

/** The newest view, the one before it, the layout and the chair's outline. */
export const now = { view: null, before: null, layout: { places: [], zones: [], undoable: false }, outline: [] };

// this module is evaluated first, so whoever hears of a view finds it here
on("view", (view) => ([now.before, now.view] = [now.view, view]));
on("layout", (layout) => (now.layout = layout));
on("chair", ({ outline }) => (now.outline = outline));
