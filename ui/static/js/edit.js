// Saving the chair's pose as a place, and the list of places and zones: rename, remove, undo.

import { ask, on } from "./link.js";
import { $, element, freeName, note, now, say, setText } from "./page.js";

const DEGREES = Math.PI / 180;
const TOLERANCES = [
  ["As usual: 15 cm, 5 degrees", 0.15, 5],
  ["At a bed: 5 cm, 2 degrees", 0.05, 2],
  ["At a table: 8 cm, 4 degrees", 0.08, 4],
  ["In a lift: 10 cm, 5 degrees", 0.1, 5],
];
const IN_GROUP = 6; // items per group in one-switch scanning
const RULES = { keep_out: "keep-out zone", slow: "slow zone", one_way: "one-way zone" };

$("save-tolerance").replaceChildren(
  ...TOLERANCES.map(([textContent], index) => element("option", { textContent, value: String(index) })),
);

let replaced = null; // name of the place that a second press on Save replaces

function willReplace(name) {
  replaced = name;
  setText($("save-place"), name === null ? "Save this place" : `Replace ${name}`);
}

$("save-here").addEventListener("submit", async (event) => {
  event.preventDefault();
  const name = $("save-name").value.trim() || freeName("place", now.layout.places);
  const replaces = replaced === name;
  if (!replaces && now.layout.places.some((place) => place.name === name)) {
    willReplace(name);
    note(`There is a place ${name} already: press once more to replace it, or choose another name`, false);
    return;
  }
  const [, tolerance_m, degrees] = TOLERANCES[Number($("save-tolerance").value)];
  const asked = { name, tolerance_m, tolerance_rad: degrees * DEGREES, replaces };
  if (await say(ask("place_here", asked))) $("save-name").value = "";
  willReplace(null);
});
$("save-name").addEventListener("input", () => willReplace(null));

$("undo").addEventListener("click", () => say(ask("undo")));

/** A line of the list: name, kind and buttons. */
function line(name, kind, actions) {
  const buttons = actions.map(([word, act]) => {
    const button = element("button", { type: "button", textContent: word });
    button.setAttribute("aria-label", `${word} ${name}`);
    if (word === "Remove") button.dataset.scan = ""; // a new name cannot be typed with one switch
    button.addEventListener("click", () => act(item));
    return button;
  });
  const item = element("li", {}, element("span", { textContent: name }, element("small", { textContent: kind })), ...buttons);
  return item;
}

/** Replaces a line's buttons by a field for a new name. */
function rename(item, place) {
  const field = element("input", { value: place.name, maxLength: 60, autocomplete: "off" });
  field.setAttribute("aria-label", `New name of ${place.name}`);
  const form = element("form", { className: "rename" }, field, element("button", { type: "submit", textContent: "Save" }));
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const name = field.value.trim();
    if (!name || name === place.name) {
      item.replaceWith(placeLine(place));
      return;
    }
    say(ask("rename_place", { name: place.name, new_name: name }));
  });
  item.replaceChildren(form);
  field.focus();
}

const placeLine = (place) =>
  line(place.name, `place, within ${Math.round(100 * place.tolerance_m)} cm`, [
    ["Rename", (item) => rename(item, place)],
    ["Remove", () => say(ask("remove_place", { name: place.name }))],
  ]);

const zoneLine = ({ name, rule }) =>
  line(name, RULES[rule], [["Remove", () => say(ask("remove_zone", { name }))]]);

/** Puts the focus on the button of the same label in the new list, else on Undo, which takes the change back. */
function keepFocus(label) {
  const again = [...$("drawn").querySelectorAll("button")].find((button) => button.getAttribute("aria-label") === label);
  (again ?? $("undo")).focus();
}

on("layout", ({ places, zones, undoable }) => {
  const lines = [...places.map(placeLine), ...zones.map(zoneLine)];
  for (const [index, item] of lines.entries()) {
    item.dataset.scanGroup = `Places and zones ${Math.floor(index / IN_GROUP) + 1}`;
  }
  const focused = $("drawn").contains(document.activeElement) && document.activeElement.getAttribute("aria-label");
  $("drawn").replaceChildren(...lines);
  $("undo").disabled = !undoable;
  if (focused) keepFocus(focused);
  $("save-name").placeholder = freeName("place", places);
});

on("chair", ({ edits }) => ($("edit-building").hidden = !edits));
$("edit-building").addEventListener("click", () => (location.href = "building"));
