// Parts that all panels of the editor share: forms, lists, numbers as text.

import { element, form } from "./forms.js";
import { say } from "./model.js";

export const $ = (id) => document.getElementById(id);
export const DEGREES = 180 / Math.PI;
export const MOST_LISTED = 200;
export const KINDS = [["end", "goal"], ["cross", "cross"], ["door", "door"], ["lift", "lift stop"]];
export const RULES = [["keep_out", "keep out"], ["slow", "slow"], ["one_way", "one way"]];

export const fail = (sentence) => say(sentence, false);
export const round = (value, digits = 3) => (value === null || value === undefined ? "" : String(Number(value.toFixed(digits))));
export const made = (settings) => form(settings, fail);
export const list = (title, things) =>
  element("ul", { className: "list", ariaLabel: title, data: { scanGroup: title } }, ...things.map(({ text, pressed, ref }) => {
    const button = element("button", { type: "button", textContent: text, data: { scan: "", ref } });
    button.addEventListener("click", pressed);
    return element("li", {}, button);
  }));
