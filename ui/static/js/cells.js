// The behaviour cells: free ways, doorways and the camera's aim round the chair, the network of cells as a live drawing, and
// the same as text. The chair is asked for them only while this tab is shown.

import { linkState, on, text, watchCells } from "./link.js";
import { $, element, now, setText } from "./page.js";
import { onTab } from "./tabs.js";

const SVG = "http://www.w3.org/2000/svg";
const FAR = 100; // units of the drawing
const REACH_M = 5; // metres from the middle to the edge of the drawing
const INNER = 46;

let shown = false;
let asked = false; // what the chair was told last
let wanted = ""; // name of the network that is drawn
let drawn = ""; // name of the network whose drawing is there
let names = "";
let boxes = new Map(); // box and texts in the drawing by the cell's name

function ask() {
  const wish = shown && document.visibilityState === "visible" && linkState() === "open";
  if (wish === asked) return;
  asked = wish;
  watchCells(wish);
}

onTab((tab) => {
  shown = tab === "cells";
  ask();
});
on("state", (state) => {
  if (state !== "open") asked = false; // a new connection knows nothing of the old one
  ask();
});
document.addEventListener("visibilitychange", ask);

function shape(tag, properties, ...classes) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(properties)) made.setAttribute(name, value);
  made.classList.add(...classes);
  return made;
}

/** A point of the drawing: ahead is up, left is left. */
const at = (angle, away) => [-Math.sin(angle) * away, -Math.cos(angle) * away];
const metres = (x, y) => [(-y / REACH_M) * FAR, (-x / REACH_M) * FAR];
const pair = ([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`;

function sector(middle, count, free) {
  const half = Math.PI / count;
  const [a, b] = [middle - half, middle + half];
  const path =
    `M${pair(at(a, INNER))}L${pair(at(a, FAR))}A${FAR} ${FAR} 0 0 0 ${pair(at(b, FAR))}` +
    `L${pair(at(b, INNER))}A${INNER} ${INNER} 0 0 1 ${pair(at(a, INNER))}z`;
  return shape("path", { d: path }, "sector", ...(free ? ["free"] : []));
}

function door({ at: [x, y, through], width, state, enough }) {
  const [left, right] = [1, -1].map((side) => {
    const reach = (side * width) / 2;
    return metres(x - Math.sin(through) * reach, y + Math.cos(through) * reach);
  });
  const place = { x1: left[0], y1: left[1], x2: right[0], y2: right[1] };
  return shape("line", place, "door", state, ...(enough ? ["enough"] : []));
}

function showRound({ sectors, doorways, aim }) {
  const parts = [];
  for (let k = 0; k < sectors.count; k += 1) {
    const middle = (2 * Math.PI * k) / sectors.count;
    const free = sectors.free.some((angle) => Math.cos(angle - middle) > Math.cos(Math.PI / sectors.count));
    parts.push(sector(middle, sectors.count, free));
  }
  const outline = now.outline.map(([x, y]) => pair(metres(x, y)).replace(" ", ",")).join(" ");
  parts.push(shape("polygon", { points: outline }, "body"));
  parts.push(...doorways.filter(({ at: [x, y] }) => Math.hypot(x, y) <= REACH_M).map(door));
  if (aim) {
    const [x2, y2] = at(aim.pan, FAR);
    parts.push(shape("line", { x1: 0, y1: 0, x2, y2 }, "aim"));
  }
  $("cells-round").replaceChildren(...parts);
}

function showLines(list, sentences) {
  if (list.children.length !== sentences.length) {
    list.replaceChildren(...sentences.map(() => element("li")));
  }
  sentences.forEach((sentence, k) => setText(list.children[k], sentence));
}

function showNetworks(networks) {
  if (names === networks.join()) return;
  names = networks.join();
  if (!networks.includes(wanted)) [wanted] = networks;
  $("cells-networks").replaceChildren(
    ...networks.map((name) => {
      const button = element("button", { type: "button", textContent: name });
      button.dataset.scan = "";
      button.setAttribute("aria-pressed", String(name === wanted));
      button.addEventListener("click", () => choose(name));
      return button;
    }),
  );
  choose(wanted);
}

function choose(name) {
  wanted = name;
  for (const button of $("cells-networks").children) {
    button.setAttribute("aria-pressed", String(button.textContent === name));
  }
  load(name);
}

async function load(name) {
  const found = await text(`api/network.svg?name=${encodeURIComponent(name)}`).catch(() => null);
  if (found === null || name !== wanted) return;
  const picture = new DOMParser().parseFromString(found, "image/svg+xml").documentElement;
  boxes = new Map();
  for (const label of picture.querySelectorAll("text[text-anchor=middle]")) {
    const frames = [];
    for (let each = label.previousElementSibling; each?.tagName === "rect"; each = each.previousElementSibling) {
      frames.push(each);
      if (each.getAttribute("fill") !== "none") break; // the box itself; a network has an inner frame besides
    }
    boxes.set(label.textContent, { label, frame: frames[frames.length - 1], marks: [] });
  }
  $("cells-drawn").replaceChildren(picture);
  drawn = name;
}

/** Lights a box, strikes it through or fades it, and writes the cell's effect and its age below the name. */
function mark(box, { state, words, age }) {
  const { label, frame } = box;
  frame.classList.toggle("active", state === "active");
  frame.classList.toggle("rests", state === "at rest");
  frame.classList.toggle("fault", state.startsWith("at fault"));
  const [x, y, wide, high] = ["x", "y", "width", "height"].map((name) => Number(frame.getAttribute(name)));
  const told = `${words || ""}${age === null ? "" : ` (${age.toFixed(1)} s)`}`.trim();
  const key = `${state} ${told}`;
  if (box.key === key) return;
  box.key = key;
  for (const each of box.marks) each.remove();
  box.marks = [];
  if (state === "inhibited") {
    box.marks.push(shape("line", { x1: x + 6, y1: y + high - 6, x2: x + wide - 6, y2: y + 6 }, "struck"));
  }
  if (told) {
    const line = shape("text", { x: x + wide / 2, y: y + high - 5, "text-anchor": "middle" }, "told");
    line.textContent = told.length > 38 ? `${told.slice(0, 37)}\u2026` : told;
    box.marks.push(line);
  }
  label.after(...box.marks);
}

const stateOf = (state) => (state.startsWith("at fault") ? "fault" : state);

function showTable(cells) {
  const table = $("cells-table");
  if (table.children.length !== cells.length) {
    table.replaceChildren(
      ...cells.map(({ name, depth }) =>
        element(
          "tr",
          {},
          element("th", { scope: "row", textContent: name, className: `deep-${Math.min(depth, 3)}` }),
          element("td"),
          element("td"),
          element("td"),
        ),
      ),
    );
  }
  cells.forEach(({ state, words, age }, k) => {
    const row = table.children[k];
    row.dataset.state = stateOf(state);
    setText(row.children[1], state);
    setText(row.children[2], words);
    setText(row.children[3], age === null ? "\u2013" : `${age.toFixed(1)} s`);
  });
}

on("cells", (seen) => {
  $("cells-there").hidden = !seen.there;
  $("cells-none").hidden = seen.there;
  if (!seen.there) {
    setText($("cells-none"), "This chair has no behaviour cells switched on (perceive).");
    return;
  }
  setText($("cells-signal"), seen.signal);
  $("cells-troubles").hidden = !seen.troubles.length;
  showLines($("cells-troubles"), seen.troubles);
  showRound(seen);
  const doors = seen.doorways.length ? seen.doorways.map(({ words }) => words) : ["No doorway is seen near."];
  showLines($("cells-said"), [seen.sectors.words, ...doors, seen.aim ? seen.aim.words : "This chair has no camera on servos."]);
  showNetworks(seen.networks);
  if (drawn === wanted) {
    for (const cell of seen.cells) if (boxes.has(cell.name)) mark(boxes.get(cell.name), cell);
  }
  showTable(seen.cells);
});
