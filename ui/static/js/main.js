// The page's entry point. Stop is loaded before it, and works without all of this.

import { ask, enter, on } from "./link.js";
import "./stop.js";
import "./map_view.js";
import "./drive.js";
import "./places.js";
import "./steer.js";
import "./draw.js";
import "./edit.js";
import "./scan.js";
import "./menu/menu.js";
import "./panel.js";
import "./cells.js";
import "./guide.js";
import "./help.js";
import "./others.js";
import "./habits.js";
import "./haptics.js";
import "./session_log.js";
import "./awake.js";
import "./focus.js";
import { remembers } from "./memory.js";
import { $, say, setText } from "./page.js";
import { setSound, soundWanted } from "./sound.js";

const STATES = {
  connecting: ["Connecting", ""],
  open: ["Connected", ""],
  lost: [
    "Not connected",
    "Connection lost. A drive that was begun here stops within a second. Use the chair's own joystick; this page reconnects by itself.",
  ],
  mute: [
    "The chair does not respond",
    "The chair's program does not respond. Use the chair's own joystick, and press its emergency stop if it moves.",
  ],
  refused: ["Token needed", "This page needs the token that waychair printed when it started."],
};

on("state", (state) => {
  const [fact, sentence] = STATES[state];
  setText($("link-fact"), fact);
  $("link-fact").dataset.state = state;
  $("lost").hidden = !sentence;
  setText($("lost"), sentence);
  document.body.classList.toggle("apart", state !== "open");
  $("door").hidden = state !== "refused";
  if (state === "refused") $("door-token").focus();
});

$("door").addEventListener("submit", (event) => {
  event.preventDefault();
  enter($("door-token").value);
});

const option = $("option-sound");
option.setAttribute("aria-pressed", String(soundWanted()));
option.addEventListener("click", () => {
  setSound(!soundWanted());
  option.setAttribute("aria-pressed", String(soundWanted()));
});
$("option-relocalise").addEventListener("click", () => say(ask("relocalise")));
$("options-forgotten").hidden = remembers();
$("not-started").remove();
