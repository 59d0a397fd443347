// Places saved where the chair stands, and everything drawn: renamed, removed, undone.

import { ask, on } from "./link.js";
import { $, element, say } from "./page.js";

const DEGREES = Math.PI / 180;
const TOLERANCES = [
  ["As usual: 15 cm, 5 degrees", 0.15, 5],
  ["At a bed: 5 cm, 2 degrees", 0.05, 2],
  ["At a table: 8 cm, 4 degrees", 0.08, 4],
  ["In a lift: 10 cm, 5 degrees", 0.1, 5],
];
const RULES = { keep_out: "keep-out zone", slow: "slow zone", one_way: "one-way zone" };

$("save-tolerance").replaceChildren(
  ...TOLERANCES.map(([textContent], index) => element("option", { textContent, value: String(index) })),
);

$("save-here").addEventListener("submit", async (event) => {
  event.preventDefault();
  const [, tolerance_m, degrees] = TOLERANCES[Number($("save-tolerance").value)];
  const asked = { name: $("save-name").value.trim(), tolerance_m, tolerance_rad: degrees * DEGREES };
  if (await say(ask("place_here", asked))) $("save-name").value = "";
});

$("undo").addEventListener("click", () => say(ask("undo")));

/** One line: the name, and what can be done with it. */
function line(name, kind, actions) {
  const buttons = actions.map(([word, act]) => {
    const button = element("button", { type: "button", textContent: word });
    button.setAttribute("aria-label", `${word} ${name}`);
    button.addEventListener("click", () => act(item));
    return button;
  });
  const item = element("li", {}, element("span", { textContent: name }, element("small", { textContent: kind })), ...buttons);
  return item;
}

/** Puts a field for another name in the place of a line's buttons. */
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
    if (await say(ask("set_place", { ...place, name }))) say(ask("remove_place", { name: place.name }));
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

on("layout", ({ places, zones, undoable }) => {
  $("drawn").replaceChildren(...places.map(placeLine), ...zones.map(zoneLine));
  $("undo").disabled = !undoable;
});
