// The chair's state: next action, last stop and obstacles; the yes before a drive, its countdown, pause and end.

import { draws } from "./draw.js";
import { ask, on } from "./link.js";
import { follow, headingInMap, onPlace, onPress } from "./map_view.js";
import { $, element, moves, note, now, say, sentenceOf, setText } from "./page.js";
import { announce, hush } from "./sound.js";
import { onStop } from "./stop.js";
import { showTab } from "./tabs.js";

const SPOKEN_MS = 2000;
const LOCALISATION = { ok: "Knows where it is", degraded: "Unsure where it is", lost: "Does not know where it is" };
const MODES = { manual: "mode-manual", guarded: "mode-manual", stopped: "mode-manual", assisted: "mode-assisted", autonomous: "mode-autonomous" };

let asked = false; // the drive was asked for on this page: only here the focus moves to the question
let counting = false;
let point = null;

/** Asks for a drive; the chair then waits for a yes. */
export async function goTo(wish) {
  asked = true;
  if (await refused(ask("go", wish))) asked = false;
}

/** Notes why a command was not done; resolves to whether so. If it was done, the sentence about the chair shows it. */
async function refused(answering) {
  const { done, sentence } = await answering;
  if (!done) note(sentence, false);
  return !done;
}

/** The goal's name in a sentence. */
const named = ({ goal }) => goal || "the point on the map";

on("view", (view) => {
  setText($("next"), sentenceOf(view.next) || "The chair stands. Choose where to go.");
  setText($("last"), view.last ? `Last stop: ${sentenceOf(view.last)}` : "");
  $("last").hidden = !view.last || moves(view);
  showFacts(view);
  showObstacles(view.obstacles);
  showQuestion(view);
  showCountdown(view);
  showModes(view);
  showPause(view);
  showStoreys(view);
  $("cancel").hidden = !(view.mode === "autonomous" || (view.mode === "assisted" && view.goal) || travels(view));
  $("reset").hidden = !view.obstacles.some((each) => each.reset);
  document.body.classList.toggle("moves", moves(view));
  speak(view);
});

/** Whether a journey over storeys is under way: its goal stays while the chair rests, such as in a lift. */
const travels = ({ storey, goal, waits }) => Boolean(storey && goal && !waits);

function showFacts({ localisation, health, twist, storey }) {
  setText($("storey-fact"), storey);
  $("storey-fact").hidden = !storey;
  setText($("place-fact"), `${LOCALISATION[localisation]} (${Math.round(100 * (health ?? 0))} %)`);
  $("place-fact").dataset.state = localisation;
  setText($("speed-fact"), `${Math.abs(twist[0]).toFixed(1)} m/s`);
}

function showObstacles(obstacles) {
  const list = $("obstacles");
  const text = JSON.stringify(obstacles);
  list.hidden = obstacles.length === 0;
  if (list.dataset.shown === text) return;
  list.dataset.shown = text;
  const items = obstacles.map(({ text: sentence, remedy }) =>
    element("li", {}, element("b", { textContent: sentenceOf(sentence) }), " ", sentenceOf(remedy)),
  );
  list.replaceChildren(...items);
}

function showQuestion(view) {
  const was = $("ask").hidden;
  $("ask").hidden = !view.waits || view.countdown !== null;
  if ($("ask").hidden) return;
  setText($("ask-title"), `Drive to ${named(view)}?`);
  setText($("ask-text"), "After your yes there are three seconds in which you can cancel.");
  if (was && asked) lookAt("ask");
}

/** Moves the focus to a question; the sentence about the chair stays in view above it. */
function lookAt(question) {
  $(`${question}-title`).focus({ preventScroll: true });
  $(question).scrollIntoView({ block: "nearest" });
  $("next").scrollIntoView({ block: "nearest" });
}

function showCountdown(view) {
  const was = counting;
  counting = view.countdown !== null;
  $("count").hidden = !counting;
  if (counting) {
    setText($("count-number"), String(Math.max(1, Math.ceil(view.countdown))));
    setText($("count-title"), `About to drive to ${named(view)}`);
  }
  if (counting && !was) {
    announce(`The chair is about to drive to ${named(view)}. Press Stop or Cancel to prevent it.`);
    if (asked) lookAt("count");
    follow(true);
  }
  if (!counting && now.before && !view.waits && !moves(view) && was) asked = false;
}

function showPause(view) {
  const goes = view.mode === "autonomous" || travels(view);
  $("pause").hidden = !goes || !view.goal || view.paused || view.countdown !== null;
  $("go-on").hidden = !view.paused && !view.offers;
}

/** Offers the stops of the lift while the chair asks at which of them it is. */
function showStoreys({ asks }) {
  const row = $("asks");
  const text = JSON.stringify(asks);
  row.hidden = asks.length === 0;
  if (row.dataset.shown === text) return;
  row.dataset.shown = text;
  row.replaceChildren(...asks.map(storeyButton));
}

function storeyButton(storey) {
  const button = element("button", { className: "big", type: "button", textContent: `This is ${storey}` });
  button.setAttribute("data-scan", "");
  button.addEventListener("click", () => void refused(ask("storey", { storey })));
  return button;
}

function showModes({ mode }) {
  for (const id of new Set(Object.values(MODES))) {
    $(id).setAttribute("aria-pressed", String(MODES[mode] === id && mode !== "stopped"));
  }
}

let said = "";
let saidAt = -Infinity;

/** Sets the sentence for screen readers, not faster than it can be read out. */
function speak(view) {
  const parts = [view.next, ...view.obstacles.map(({ text, remedy }) => `${text}: ${remedy}`)];
  const text = parts.map(sentenceOf).filter(Boolean).join(" ");
  if (text === said || performance.now() - saidAt < SPOKEN_MS) return;
  [said, saidAt] = [text, performance.now()];
  setText($("said"), text);
}

onPlace((place) => goTo({ place: place.name }));
onPress(([x, y]) => {
  if (draws()) return;
  point = [x, y];
  $("here").hidden = false;
  setText($("here-title"), "This point on the map");
});

/** A pose at the pressed point, heading away from the chair. */
function posed() {
  const from = now.view?.pose;
  const heading = from ? Math.atan2(point[1] - from[1], point[0] - from[0]) : headingInMap(0);
  return [...point, heading];
}

const closePoint = () => {
  $("here").hidden = true;
  point = null;
};

$("here-drive").addEventListener("click", () => {
  goTo({ pose: posed() });
  closePoint();
});
$("here-found").addEventListener("click", () => {
  const heading = now.view?.pose?.[2] ?? headingInMap(0);
  say(ask("relocalise", { pose: [...point, heading] }));
  closePoint();
});
$("here-no").addEventListener("click", closePoint);
$("ask-yes").addEventListener("click", () => refused(ask("confirm", { goal: now.view.goal })));
$("ask-no").addEventListener("click", () => say(ask("cancel")));
$("count-no").addEventListener("click", () => say(ask("cancel")));
$("pause").addEventListener("click", () => refused(ask("pause")));
$("go-on").addEventListener("click", () => refused(ask("go_on")));
$("cancel").addEventListener("click", () => say(ask("cancel")));
$("reset").addEventListener("click", () => say(ask("reset")));
$("mode-manual").addEventListener("click", () => {
  if (now.view?.goal || moves(now.view)) say(ask("cancel"));
  else note("You already have the joystick.");
});
$("mode-assisted").addEventListener("click", () => showTab("steer", "stick"));
$("mode-autonomous").addEventListener("click", () => showTab("places", "search"));
onStop(() => {
  asked = false;
  closePoint();
  hush();
});
