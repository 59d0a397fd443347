// Stop: by pointer, by Enter on the button, by Esc anywhere, by Space outside text fields. This module imports nothing and is
// loaded before all others, so that Stop works if any other part of the page fails. Stop is sent by fetch, and at the same
// time over the socket once there is one.

const UNANSWERED_MS = 2000;
const NOTE_MS = 16_000;
const TOKEN_PART = "#token="; // of the address
const STOPPED = new EventTarget();

const ways = [() => post("stop").then((response) => response.json())];
const switches = []; // modes in which Space is a switch: {handler, stops} each

/** The value of a function, null where it fails: storage may be blocked, full or damaged. */
function tried(work) {
  try {
    return work();
  } catch {
    return null;
  }
}

let token = tried(() => sessionStorage.getItem("token")) || tried(() => history.state?.token) || "";
readAddress();
addEventListener("hashchange", readAddress);

function readAddress() {
  if (!location.hash.startsWith(TOKEN_PART)) return;
  useToken(tried(() => decodeURIComponent(location.hash.slice(TOKEN_PART.length))) ?? token);
}

/** The token that this page sends, empty without one. */
export const pageToken = () => token;

/** Takes another token, and keeps it for reloads out of sight and of bookmarks. */
export function useToken(next) {
  token = typeof next === "string" ? next : "";
  tried(() => sessionStorage.setItem("token", token));
  tried(() => history.replaceState({ token }, "", location.pathname));
}

export const headers = () => (token ? { authorization: `Bearer ${token}` } : {});

/** Sends a command by fetch. */
const post = (name) => fetch(`api/do/${name}`, { method: "POST", headers: headers(), keepalive: true, body: "{}" });

/** Adds another way to send Stop: a function that resolves to the chair's answer {done, sentence}. */
export const alsoBy = (way) => ways.push(way);

/**
 * Registers a mode in which Space is a switch. `handler`: true where it has used the press of Space, which then is not Stop.
 * `stops`: whether Space has to be Stop in text fields, too.
 */
export const onSpace = (handler, stops) => switches.push({ handler, stops });

/** Registers a listener for Stop. */
export const onStop = (heard) => STOPPED.addEventListener("stop", heard);

export function stop() {
  heed(ways.map(sent));
  STOPPED.dispatchEvent(new Event("stop"));
  const button = document.getElementById("stop");
  button?.classList.remove("pressed");
  void button?.offsetWidth; // restarts the animation
  button?.classList.add("pressed");
}

/** Sends Stop by one way; rejects where the chair has not obeyed, so that no way hinders another. */
async function sent(way) {
  const answer = await way();
  if (!answer.done) throw new Error(answer.sentence);
}

/** Warns if no way has brought an answer to Stop; confirms it where nothing else on this page would. */
async function heed(tries) {
  const late = new Promise((_, reject) => setTimeout(reject, UNANSWERED_MS));
  try {
    await Promise.race([Promise.any(tries), late]);
    if (document.getElementById("not-started")) showNote("The chair has obeyed Stop.", "note");
  } catch {
    showNote("No answer to Stop: check that the chair stands.", "note bad");
  }
}

/** Shows a sentence for some time, an equal one only once. */
export function showNote(textContent, className, lastsMs = NOTE_MS) {
  const notes = document.getElementById("notes");
  for (const other of [...(notes?.children ?? [])]) if (other.textContent === textContent) other.remove();
  const made = Object.assign(document.createElement("p"), { textContent, className });
  notes?.append(made);
  setTimeout(() => made.remove(), lastsMs);
}

const isTextField = (element) =>
  element instanceof HTMLTextAreaElement ||
  (element instanceof HTMLInputElement && !["button", "checkbox", "radio", "submit"].includes(element.type));

const onButton = ({ target }) => target instanceof Element && target.closest("#stop") !== null;

function pressed(event) {
  if (event.key !== "Escape" && event.key !== " ") return;
  if (event.key === " " && isTextField(event.target) && !switches.some(({ stops }) => asked(stops))) return;
  event.preventDefault(); // so that Space presses no button, neither on keydown nor on keyup
  if (event.type === "keyup" || event.repeat) return;
  if (event.key === " " && switches.some(({ handler }) => asked(handler))) return;
  stop();
}

/** The answer of a mode; if it fails, Space is Stop. */
const asked = (handler) => tried(handler) ?? false;

// on the window, before all other listeners, and also before the button is there
addEventListener("pointerdown", (event) => onButton(event) && stop(), true);
addEventListener(
  "click",
  (event) => event.detail === 0 && onButton(event) && stop(), // by keyboard or an assistive device, without a pointer
  true,
);
addEventListener("keydown", pressed, true);
addEventListener("keyup", pressed, true);
