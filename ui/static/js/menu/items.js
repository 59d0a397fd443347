// The items of the menu: goals, modes and every option. An item is {label, detail, ...} with one of `items` (a function to the
// items of a menu), `act` (work, after which the menu begins again; true keeps it open) or `hold` (steering while held).

import { goTo } from "../drive.js";
import { guideTo, PROMPTS, letDrive, nextLevel, sayAgain } from "../guide.js";
import { chooseLevel, LEVELS, override } from "../help.js";
import { leadThrough, nextDoors, sayStep, sayWhere } from "../haptics.js";
import { ask } from "../link.js";
import { moves, note, now, say } from "../page.js";
import { setSound, soundWanted } from "../sound.js";
import { stop } from "../stop.js";
import { METHODS, OPTIONS } from "./access.js";
import { effort, goalItems, MOST, nearest } from "./goal_tree.js";
import { favourites, keep, options, SIZES, toggleFavourite } from "./options.js";

const NEAR = 6; // goals under "Near here"

const STOP = { label: "Stop", act: stop, kind: "stop" };
const TIMES = {
  sweep: "Time per item",
  first: "First item longer by",
  acceptance: "A press counts from",
  release: "Pause after a press",
  long: "A long press lasts",
  rounds: "Rounds before the frame rests",
};

/** The goals of the building in its order, else the places of the map: {name, path, pose, seconds, lifts}. */
function goals() {
  const poses = new Map(now.layout.places.map(({ name, pose }) => [name, pose]));
  const known = now.goals.length ? now.goals : now.layout.places.map(({ name }) => ({ name, path: name.split("/") }));
  return known.map((goal) => ({ ...goal, pose: poses.get(goal.name) }));
}

const goalItem = (goal) => ({ label: goal.path.at(-1), detail: effort(goal), act: () => void goTo({ place: goal.name }) });

/** A goal outside its own menu: with the names of the menus that it is in. */
const farItem = (goal) => ({ ...goalItem(goal), detail: [goal.path.slice(0, -1).join(", "), effort(goal)].filter(Boolean).join(": ") });

const asItems = (nodes, item) =>
  nodes.map(({ label, goal, items }) => (goal ? { ...item(goal), label } : { label, items: () => asItems(items, item) }));

/** The first menu: depends on what the chair does. */
export function firstMenu(leave, calibrate) {
  const view = now.view;
  if (!view) return { title: "Waiting for the chair", items: [STOP] };
  if (view.waits && view.countdown === null) {
    return {
      title: `Drive to ${view.goal || "the point on the map"}?`,
      items: [
        { label: "Drive there", act: () => answered(ask("confirm", { goal: view.goal })) },
        ...(now.goals.length ? [{ label: "Guide me, I drive", act: () => void guideTo(view.goal) }] : []),
        { label: "Not now", act: () => void say(ask("cancel")) },
        STOP,
      ],
    };
  }
  if (moves(view)) {
    const others = [
      { label: "Pause", act: () => answered(ask("pause")) },
      { label: "End this drive", act: () => void say(ask("cancel")) },
    ];
    return { title: "The switch is Stop", items: view.mode === "autonomous" && view.countdown === null ? [STOP, ...others] : [STOP] };
  }
  return { title: "Menu", items: atRest(view, leave, calibrate) };
}

function atRest(view, leave, calibrate) {
  const all = goals();
  const pinned = favourites().flatMap((name) => all.find((goal) => goal.name === name) ?? []);
  const near = nearest(all, view.pose, NEAR);
  return [
    STOP,
    ...view.asks.map((storey) => ({ label: `This is ${storey}`, act: () => answered(ask("storey", { storey })) })),
    ...(view.paused || view.offers ? [{ label: "Go on", act: () => answered(ask("go_on")) }] : []),
    ...(view.guide ? guidance(view.guide) : []),
    ...(now.haptics ? touch(all) : []),
    ...(view.goal ? [{ label: "End this drive", act: () => void say(ask("cancel")) }] : []),
    ...(view.guard?.capped ? [{ label: "Creep on for ten seconds", act: () => void override() }] : []),
    ...(view.obstacles.some(({ reset }) => reset) ? [{ label: "Reset", act: () => void say(ask("reset")) }] : []),
    ...(pinned.length ? [{ label: "Favourites", items: () => pinned.slice(0, MOST).map(farItem) }] : []),
    ...(near.length && all.length > MOST ? [{ label: "Near here", items: () => near.map(farItem) }] : []),
    ...asItems(goalItems(all), goalItem),
    { label: "Who drives", items: () => modes(all) },
    ...(view.guard ? [{ label: "Help while I drive", detail: view.guard.level, items: helps }] : []),
    { label: "Options", items: () => choices(leave, calibrate) },
  ];
}

const guidance = ({ level, offers, arrived }) => [
  { label: "Say it again", act: () => sayAgain() },
  ...(offers && !arrived ? [{ label: "Let the chair drive", act: () => letDrive() }] : []),
  { label: "Prompts", detail: PROMPTS[level], act: () => void nextLevel() },
  { label: "End guidance", act: () => void say(ask("end_guide")) },
];

/** The items of a rider who is led by touch and voice. */
function touch(all) {
  const led = now.haptics.goal !== "";
  const here = all.filter(({ pose }) => pose); // nobody is led to another storey
  const doors = () => nextDoors.map(({ textContent: label, dataset }) => ({ label, act: () => leadThrough(dataset.side) }));
  const leadItem = (goal) => ({ label: goal.path.at(-1), act: () => void say(ask("lead", { goal: goal.name })) });
  return [
    { label: led ? "Say the step again" : "Say it again", act: () => void sayStep() },
    { label: "Where am I?", act: () => void sayWhere() },
    ...(led
      ? [{ label: "Lead me no longer", act: () => void say(ask("end_lead")) }]
      : [
          { label: "Lead me", items: () => asItems(goalItems(here), leadItem) },
          { label: "Through the next door", items: doors },
        ]),
  ];
}

/** Notes why a command was not done. */
async function answered(answering) {
  const { done, sentence } = await answering;
  if (!done) note(sentence, false);
}

const HELPS = { inform: "nothing slows you", guard: "slows and stops", guide: "guards and leads" };

/** The levels of help, that in force marked. */
function helps() {
  return LEVELS.map((level) => ({
    label: level[0].toUpperCase() + level.slice(1),
    detail: now.view?.guard?.level === level ? "chosen" : HELPS[level],
    act: () => void chooseLevel(level),
  }));
}

const startItem = (goal) => ({ label: goal.path.at(-1), act: () => void say(ask("start_at", { goal: goal.name })) });

function modes(all) {
  return [
    { label: "I drive, by joystick", act: () => void say(ask("cancel")) },
    {
      label: "I steer here",
      detail: "hold to move, let go to stop",
      items: () =>
        options.access.method === "inverse"
          ? [{ label: "Steering needs another way of pressing than hold and let go", act: () => true }]
          : [
              { label: "Forward", hold: [1, 0] },
              { label: "Left", hold: [0, 1] },
              { label: "Right", hold: [0, -1] },
              { label: "Backward", hold: [-1, 0] },
            ],
    },
    { label: "Locate the chair again", act: () => void say(ask("relocalise")) },
    ...(all.length ? [{ label: "I am at a place", detail: "the chair finds itself there", items: () => asItems(goalItems(all), startItem) }] : []),
  ];
}

function choices(leave, calibrate) {
  const { access } = options;
  return [
    { label: "How I press", detail: METHODS[access.method], items: methods },
    { label: "Times", detail: `${shown("sweep")} per item`, items: () => times(calibrate) },
    { label: "Sound", items: sounds },
    { label: "Size of the text", detail: options.size, items: sizes },
    { label: "Favourites", detail: `${favourites().length} chosen`, items: chooseFavourites },
    { label: "Leave the menu", detail: "to the page with all buttons", act: leave },
  ];
}

function methods() {
  return Object.entries(METHODS).map(([method, label]) => ({
    label,
    detail: options.access.method === method ? "now" : "",
    act: () => {
      options.access.method = method;
      keep();
    },
  }));
}

const unit = (name) => (name === "rounds" ? "" : " s");
const shown = (name) => `${Number(options.access[name].toFixed(1))}${unit(name)}`;

function times(calibrate) {
  return [
    { label: "Measure my presses", detail: "ten presses", act: calibrate },
    ...Object.keys(TIMES).map((name) => ({ label: TIMES[name], detail: shown(name), items: () => longerOrShorter(name) })),
  ];
}

function longerOrShorter(name) {
  const [, least, most, step] = OPTIONS[name];
  const by = (steps) => () => {
    const wanted = options.access[name] + steps * step;
    options.access[name] = Number(Math.min(most, Math.max(least, wanted)).toFixed(1));
    keep();
    return true;
  };
  return [
    { label: "More", detail: `now ${shown(name)}`, act: by(1) },
    { label: "Less", detail: `now ${shown(name)}`, act: by(-1) },
    { label: "Much more", act: by(5) },
    { label: "Much less", act: by(-5) },
  ];
}

const toggled = (label, name) => ({
  label,
  detail: options[name] ? "on" : "off",
  act: () => {
    options[name] = !options[name];
    keep();
    return true;
  },
});

function sounds() {
  return [
    toggled("Speak each item", "spoken"),
    toggled("Beep at each item", "beeps"),
    {
      label: "Tone and voice before the chair moves",
      detail: soundWanted() ? "on" : "off",
      act: () => {
        setSound(!soundWanted());
        return true;
      },
    },
  ];
}

function sizes() {
  return Object.keys(SIZES).map((size) => ({
    label: size[0].toUpperCase() + size.slice(1),
    detail: options.size === size ? "now" : "",
    act: () => {
      options.size = size;
      keep();
      return true;
    },
  }));
}

function chooseFavourites() {
  const pinned = new Set(favourites());
  const item = (goal) => ({
    label: goal.path.at(-1),
    detail: pinned.has(goal.name) ? "a favourite: press to take it away" : "",
    act: () => {
      toggleFavourite(goal.name);
      return true;
    },
  });
  return asItems(goalItems(goals()), item);
}
