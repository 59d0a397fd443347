// The list of places as large buttons, filtered by typing; recent goals come first.

import { goTo } from "./drive.js";
import { on } from "./link.js";
import { recallList, remember } from "./memory.js";
import { $, element, now } from "./page.js";

const IN_GROUP = 6; // places per group in one-switch scanning

const latest = () => recallList("latest");

function choose(name) {
  remember("latest", JSON.stringify([name, ...latest().filter((other) => other !== name)].slice(0, 5)));
  goTo({ place: name });
}

function inOrder(places) {
  const first = latest();
  const rank = ({ name }) => (first.includes(name) ? first.indexOf(name) : first.length);
  return [...places].sort((a, b) => rank(a) - rank(b) || a.name.localeCompare(b.name));
}

export function listPlaces() {
  const wish = $("search").value.trim().toLocaleLowerCase();
  const shown = inOrder(now.layout.places).filter(({ name }) => name.toLocaleLowerCase().includes(wish));
  const focused = document.activeElement?.dataset?.place;
  $("place-list").replaceChildren(
    ...shown.map(({ name }, index) => {
      const button = element("button", { type: "button", className: "place", textContent: name });
      button.dataset.scan = "";
      button.dataset.place = name;
      button.addEventListener("click", () => choose(name));
      const item = element("li", {}, button);
      item.dataset.scanGroup = `Places ${Math.floor(index / IN_GROUP) + 1}`;
      return item;
    }),
  );
  if (focused) [...$("place-list").querySelectorAll("button")].find(({ dataset }) => dataset.place === focused)?.focus();
  $("no-place").hidden = shown.length > 0;
  $("no-place").textContent = wish
    ? "No place has this in its name."
    : "This map has no places yet. Drive to one by joystick, then save it under Edit.";
}

on("layout", listPlaces);
$("search").addEventListener("input", listPlaces);
$("search").addEventListener("keydown", ({ key }) => {
  const only = $("place-list").querySelectorAll("button");
  if (key === "Enter" && only.length === 1) only[0].click();
});
