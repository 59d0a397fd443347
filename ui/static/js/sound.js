// A tone and a spoken phrase before the chair moves. The page shows the same in words.

import { recall, remember } from "./memory.js";

let context = null;
let wanted = recall("sound") !== "off";

export const soundWanted = () => wanted;

export function setSound(on) {
  wanted = on;
  remember("sound", on ? "on" : "off");
  if (!on) hush();
}

let said = null; // the phrase that is spoken: {phrase, ended, mustBeHeard}
let waits = { important: null, other: null }; // the latest phrases that wait, of either kind
let held = false; // the chair itself speaks

/** Ends the phrase that is being spoken, and forgets those that wait. */
export function hush() {
  [said, waits] = [null, { important: null, other: null }];
  globalThis.speechSynthesis?.cancel();
}

/** Two soft notes, then the phrase where this browser has a voice. */
export function announce(phrase) {
  if (!wanted) return;
  for (const part of [() => tone(660, 0), () => tone(880, 0.22), hush, () => globalThis.speechSynthesis && begin({ phrase, ended: () => {} })]) {
    try {
      part();
    } catch {
      // no sound or no voice on this computer
    }
  }
}

/**
 * Speaks a phrase in place of the present one, then calls `ended`; false where this browser has no voice. A phrase that must be
 * heard is not cut off: the latest other one waits for its end.
 */
export function speakOnly(phrase, ended, mustBeHeard = false) {
  try {
    if (!globalThis.speechSynthesis?.getVoices().length) return false;
    begin({ phrase, ended, mustBeHeard });
    return true;
  } catch {
    return false;
  }
}

/** Lets this page's voice wait while the chair itself speaks: a phrase that is cut off by it is spoken anew afterwards. */
export function holdVoice(on) {
  if (held === on) return;
  held = on;
  if (!on) {
    next();
    return;
  }
  const cut = said;
  if (!cut) return;
  said = null;
  globalThis.speechSynthesis?.cancel();
  waits[kindOf(cut)] ??= cut;
}

const kindOf = ({ mustBeHeard }) => (mustBeHeard ? "important" : "other");

function begin(job) {
  if (held || (said?.mustBeHeard && !job.mustBeHeard)) {
    waits[kindOf(job)] = job;
    return;
  }
  hush();
  speak(job);
}

/** Speaks what waits, the important first. */
function next() {
  const job = waits.important ?? waits.other;
  if (!job) return;
  waits[kindOf(job)] = null;
  speak(job);
}

/** A short note after some seconds, also where tone and voice before a motion are off. */
export function beep(frequency, after = 0) {
  try {
    tone(frequency, after);
  } catch {
    // no sound on this computer
  }
}

/** Two notes that fall, for people and chairs on the way that this chair enters; also where tone and voice are off. */
export function warn() {
  beep(880);
  beep(660, 0.3);
}

function speak(job) {
  const spoken = new SpeechSynthesisUtterance(job.phrase);
  spoken.lang = "en";
  said = job;
  spoken.onend = spoken.onerror = () => {
    if (said !== job) return;
    said = null;
    job.ended();
    if (!said && !held) next();
  };
  speechSynthesis.speak(spoken);
}

function tone(frequency, after) {
  context ??= new AudioContext();
  const [from, note, volume] = [context.currentTime + after, context.createOscillator(), context.createGain()];
  note.frequency.value = frequency;
  volume.gain.setValueAtTime(0, from);
  volume.gain.linearRampToValueAtTime(0.2, from + 0.03);
  volume.gain.exponentialRampToValueAtTime(0.001, from + 0.4);
  note.connect(volume).connect(context.destination);
  note.start(from);
  note.stop(from + 0.45);
}
