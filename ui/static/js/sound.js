// A tone and a spoken phrase before the chair moves. The page shows the same in words.

let context = null;
let wanted = localStorage.getItem("sound") !== "off";

export const soundWanted = () => wanted;

export function setSound(on) {
  wanted = on;
  localStorage.setItem("sound", on ? "on" : "off");
  if (!on) globalThis.speechSynthesis?.cancel();
}

/** Two soft notes, then the phrase where this browser has a voice. */
export function announce(phrase) {
  if (!wanted) return;
  tone(660, 0);
  tone(880, 0.22);
  if (!globalThis.speechSynthesis) return;
  speechSynthesis.cancel();
  const spoken = new SpeechSynthesisUtterance(phrase);
  spoken.lang = "en";
  speechSynthesis.speak(spoken);
}

function tone(frequency, after) {
  try {
    context ??= new AudioContext();
  } catch {
    return; // no sound on this computer
  }
  const [from, note, volume] = [context.currentTime + after, context.createOscillator(), context.createGain()];
  note.frequency.value = frequency;
  volume.gain.setValueAtTime(0, from);
  volume.gain.linearRampToValueAtTime(0.2, from + 0.03);
  volume.gain.exponentialRampToValueAtTime(0.001, from + 0.4);
  note.connect(volume).connect(context.destination);
  note.start(from);
  note.stop(from + 0.45);
}
