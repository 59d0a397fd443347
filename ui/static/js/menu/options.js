// The rider's own options of the menu, kept by this browser: access, times, sound, size of the text, favourites.

import { recall, recallList, remember } from "../memory.js";
import { sound } from "./access.js";

export const SIZES = { normal: 1, large: 1.4, largest: 1.8 };

function read() {
  let kept = null;
  try {
    kept = JSON.parse(recall("menu") ?? "null");
  } catch {
    // damaged: the defaults
  }
  return {
    access: sound(kept?.access ?? null),
    spoken: kept?.spoken === true,
    beeps: kept?.beeps === true,
    size: kept?.size in SIZES ? kept.size : "normal",
    own: kept?.own === true, // the rider has chosen this page's menu
  };
}

export const options = read();

export function keep() {
  remember("menu", JSON.stringify(options));
}

export const favourites = () => recallList("favourites");

/** Adds a favourite, or takes it away. */
export function toggleFavourite(name) {
  const names = favourites();
  remember("favourites", JSON.stringify(names.includes(name) ? names.filter((other) => other !== name) : [...names, name]));
}
