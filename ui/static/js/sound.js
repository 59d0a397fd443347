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

let important = false; // a phrase is spoken that another one waits for
let waiting = null; // {phrase, ended}

/** Ends the phrase that is being spoken. */
export function hush() {
  [important, waiting] = [false, null];
  globalThis.speechSynthesis?.cancel();
}

/** Two soft notes, then the phrase where this browser has a voice. */
export function announce(phrase) {
  if (!wanted) return;
  for (const part of [() => tone(660, 0), () => tone(880, 0.22), hush, () => globalThis.speechSynthesis && speak(phrase)]) {
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
    if (important && !mustBeHeard) {
      waiting = { phrase, ended };
      return true;
    }
    hush();
    important = mustBeHeard;
    const said = speak(phrase);
    said.onend = said.onerror = () => {
      if (current !== said) return;
      const next = waiting;
      [important, waiting] = [false, null];
      ended();
      if (next) speakOnly(next.phrase, next.ended);
    };
    return true;
  } catch {
    return false;
  }
}

let current = null;

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

function speak(phrase) {
  const spoken = new SpeechSynthesisUtterance(phrase);
  spoken.lang = "en";
  current = spoken;
  speechSynthesis.speak(spoken);
  return spoken;
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
