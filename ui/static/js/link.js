// The connection to the chair by a socket. Silence counts as a lost connection.

import { alsoBy, headers, pageToken, useToken } from "./stop.js";

const SILENT_MS = 1000;
const TRIED_MS = 2000; // timeout of a try to connect
const RETRY_MS = 300;
const HEARD = new EventTarget();

const id = `${Date.now()}-${Math.random()}`; // of this page

let socket = null;
let heardAt = performance.now();
let triedAt = heardAt;
let stamp = null;
let stampAt = performance.now();
let state = "connecting"; // connecting, open, lost, mute (the views do not change), refused
let number = 0;
const waiting = new Map();

/** Registers a listener: "chair", "map", "layout", "cells", "haptics" and "view" pass the message, "state" the connection's state. */
export const on = (kind, heard) => HEARD.addEventListener(kind, (event) => heard(event.detail));

export const linkState = () => state;

export function enter(token) {
  useToken(token);
  connect();
}

const tell = (kind, detail) => HEARD.dispatchEvent(new CustomEvent(kind, { detail }));

function become(next) {
  if (next === state) return;
  state = next;
  if (next !== "open") {
    for (const done of waiting.values()) done({ done: false, sentence: "The connection to the chair was lost." });
    waiting.clear();
  }
  tell("state", state);
}

function connect() {
  const mine = opened();
  if (!mine) return;
  socket?.close();
  socket = mine;
  triedAt = performance.now();
  mine.onopen = () => mine.send(JSON.stringify({ token: pageToken(), page: id }));
  mine.onmessage = ({ data }) => mine === socket && hear(JSON.parse(data));
  mine.onclose = ({ code }) => {
    if (mine !== socket) return;
    socket = null;
    if (code === 4401) {
      become("refused");
    } else {
      become("lost");
      setTimeout(() => socket ?? connect(), RETRY_MS);
    }
  };
}

/** A new socket; null where this browser refuses one. */
function opened() {
  try {
    return new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/live`);
  } catch {
    setTimeout(() => {
      become("lost");
      socket ?? connect();
    }, TRIED_MS);
    return null;
  }
}

function hear(message) {
  heardAt = performance.now();
  if (message.type === "view") {
    answer(message.n);
    if (message.stamp !== stamp) [stamp, stampAt] = [message.stamp, heardAt];
    become(heardAt - stampAt > SILENT_MS ? "mute" : "open");
  }
  if (message.type === "answer") {
    waiting.get(message.id)?.(message);
    waiting.delete(message.id);
  }
  tell(message.type, message);
}

let leaves = false; // during a reload the page is hidden for a moment; that is not reported

const answer = (seen) =>
  !leaves &&
  socket?.readyState === WebSocket.OPEN &&
  socket.send(JSON.stringify({ seen, visible: document.visibilityState === "visible" }));

/** Whether the socket, or the try to connect, has timed out. */
function isSilent() {
  const silent = performance.now() - Math.max(heardAt, triedAt);
  if (state === "open" || state === "mute") return silent > SILENT_MS;
  return socket !== null && silent > TRIED_MS;
}

setInterval(() => {
  if (!isSilent()) return;
  become("lost");
  socket?.close();
  socket = null;
  connect();
}, 200);

document.addEventListener("visibilitychange", () => answer(0));
addEventListener("hashchange", () => state === "refused" && connect()); // the address was opened again, with a token
addEventListener("pagehide", () => (leaves = true));
addEventListener("pageshow", () => (leaves = false));

/** Sends a command to the chair; resolves to {done, sentence}, also where the connection is lost. */
export function ask(name, asked = {}) {
  if (socket?.readyState !== WebSocket.OPEN) {
    return Promise.resolve({ done: false, sentence: "The page has no connection to the chair." });
  }
  number += 1;
  const mine = number;
  socket.send(JSON.stringify({ do: name, with: asked, id: mine }));
  return new Promise((done) => waiting.set(mine, done));
}

/** Asks the chair for messages about its behaviour cells, or for no more. */
export function watchCells(wanted) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ cells: wanted }));
}

/** The text of a file of the chair, null where there is none. */
export async function text(path) {
  const found = await fetch(path, { headers: headers() });
  return found.status === 200 ? found.text() : null;
}

/** A picture as an object URL, null where there is none. */
export async function picture(path) {
  const found = await fetch(path, { headers: headers() });
  return found.status === 200 ? URL.createObjectURL(await found.blob()) : null;
}

alsoBy(() => ask("stop"));
connect();
