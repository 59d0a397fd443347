// A rider who is told and led by touch and voice: the glove's motors, the present step, all that was said, and the same as text.
// Each thing that is said is announced to screen readers once.

import { ask, on } from "./link.js";
import { $, element, now, say, sentenceOf, setText } from "./page.js";
import { holdVoice } from "./sound.js";

const SVG = "http://www.w3.org/2000/svg";
const MOST_SAID = 12;
const GAP_MM = 70; // between the drawings of two sites, such as two wrists
const SYMBOLS = { swivel_left: "turn left", swivel_right: "turn right", nudge_left: "a bit left", nudge_right: "a bit right", obstacle_at: "obstacle" };

let heard = null; // how many things had been said when the page last looked
let layout = "";
let motors = [];
let places = "";
let playing = 0; // number of the pattern that is shown

/** Says a text to screen readers, also if it is the one before once more. */
function announce(text) {
  const region = $("haptics-announced");
  region.textContent = "";
  setTimeout(() => (region.textContent = text), 50);
}

function note(seen) {
  const list = $("haptics-said");
  const felt = seen.symbol === "" ? "" : seen.unfelt ? ` (not felt: ${seen.unfelt})` : " (felt)";
  const symbol = SYMBOLS[seen.symbol] ?? seen.symbol;
  list.prepend(element("li", { textContent: `${symbol ? `${symbol}: ` : ""}${seen.text}${felt}` }));
  while (list.children.length > MOST_SAID) list.lastChild.remove();
}

function motor(cx, cy, r) {
  const made = document.createElementNS(SVG, "circle");
  for (const [name, value] of Object.entries({ cx, cy, r })) made.setAttribute(name, value);
  made.classList.add("motor");
  return made;
}

/** Draws the motors of a layout: ahead is up, left is left; sites stand side by side. */
function drawGlove({ layout: name, at }) {
  if (layout === name) return;
  layout = name;
  const sites = [...new Set(at.map(([, , site]) => site))];
  const points = at.map(([left, ahead, site]) => [-left + sites.indexOf(site) * GAP_MM, -ahead]);
  const size = Math.max(30, ...points.flat().map(Math.abs));
  const r = Math.max(size / 9, 5);
  motors = points.map(([x, y]) => motor(x, y, r));
  const [xs, ys] = [0, 1].map((k) => points.map((point) => point[k]));
  const [x, y] = [Math.min(...xs) - 2 * r, Math.min(...ys) - 2 * r];
  const drawing = $("haptics-glove");
  drawing.setAttribute("viewBox", `${x} ${y} ${Math.max(...xs) + 2 * r - x} ${Math.max(...ys) + 2 * r - y}`);
  drawing.replaceChildren(...motors);
}

/** Lights the motors of each burst in turn, as they vibrate. */
async function show(play) {
  playing += 1;
  const mine = playing;
  for (const [places_, on_, off] of play) {
    for (const [k, each] of motors.entries()) each.classList.toggle("on", places_.includes(k));
    await new Promise((done) => setTimeout(done, on_));
    if (mine !== playing) return;
    for (const each of motors) each.classList.remove("on");
    await new Promise((done) => setTimeout(done, off));
    if (mine !== playing) return;
  }
}

function gloveWords(glove) {
  if (!glove) return "No glove: you are told by voice and text.";
  if (glove.problem) return `The glove: ${glove.problem}.`;
  return `The glove is worn and well, ${glove.at.length} motors${glove.broken.length ? `, ${glove.broken.length} of them broken` : ""}.`;
}

function stepWords(seen) {
  if (seen.withheld) return `Steps are withheld: ${seen.withheld}.`;
  if (seen.goal) return seen.step ? `Now: ${seen.step}. ${sentenceOf(seen.reason)}` : "Looks for a way.";
  return seen.arrived ? "You have arrived." : seen.reason ? `Nobody is led: ${seen.reason}.` : "Choose a place to be led to.";
}

function showPlaces() {
  const names = now.layout.places.map(({ name }) => name);
  if (places === names.join("\n")) return;
  places = names.join("\n");
  $("haptics-places").replaceChildren(
    ...names.map((name) => {
      const button = element("button", { type: "button", textContent: name });
      button.dataset.scan = "";
      button.addEventListener("click", () => say(ask("lead", { goal: name })));
      return element("li", {}, button);
    }),
  );
}

on("haptics", (seen) => {
  now.haptics = seen.there ? seen : null;
  holdVoice(seen.there && seen.speaks);
  $("haptics-there").hidden = !seen.there;
  $("haptics-none").hidden = seen.there;
  if (!seen.there) return;
  setText($("haptics-goal"), seen.goal ? `On the way to ${seen.goal}` : "Not led");
  setText($("haptics-step"), stepWords(seen));
  setText($("haptics-glove-text"), gloveWords(seen.glove));
  $("haptics-glove").toggleAttribute("hidden", !seen.glove);
  $("haptics-end").hidden = !seen.goal;
  if (seen.glove) {
    drawGlove(seen.glove);
    for (const [k, each] of motors.entries()) each.classList.toggle("broken", seen.glove.broken.includes(k));
  }
  const notices = $("haptics-notices");
  if (notices.children.length !== seen.notices.length) notices.replaceChildren(...seen.notices.map(() => element("li")));
  seen.notices.forEach((sentence, k) => setText(notices.children[k], sentence));
  notices.hidden = !seen.notices.length;
  if (heard !== null && seen.count > heard) {
    announce(seen.text);
    note(seen);
    show(seen.play);
  }
  heard = seen.count;
});
on("layout", () => setTimeout(showPlaces, 0)); // the newest layout is noted first
on("state", (state) => {
  if (state === "open") return;
  heard = null; // another program counts anew
  holdVoice(false);
});

/** Asks the chair to say the present step again, or where it is. */
export const sayStep = () => say(ask("say_again"));
export const sayWhere = () => say(ask("say_where"));

/** Asks to be led through the next door on a side: left, ahead or right. */
export const leadThrough = (side) => void say(ask("lead_through", { side }));

/** The buttons of the sides. */
export const nextDoors = [...$("haptics-doors").children];

for (const button of nextDoors) button.addEventListener("click", () => leadThrough(button.dataset.side));
$("haptics-again").addEventListener("click", sayStep);
$("haptics-where").addEventListener("click", sayWhere);
$("haptics-end").addEventListener("click", () => say(ask("end_lead")));
