// Keeps the screen on during a drive, since a page that is out of sight ends it; says where this browser cannot, and where a
// drive has ended so. Browsers offer the lock only to pages by https or from this computer (Screen Wake Lock API).

import { on } from "./link.js";
import { $, now, setText } from "./page.js";

const RETRY_MS = 5000; // after a refusal, such as a low battery's
const OLD_VIEWS_MS = 3000; // views from before this page was hidden may still arrive for so long

let lock = null;
let wanted = false;
let asks = false;
let refused = !navigator.wakeLock;
let triedAt = -Infinity;
let leftAt = -Infinity; // when this page was hidden in a drive
let backAt = null; // when it was seen again, until the drive's end is known

const isSeen = () => document.visibilityState === "visible";
const inDrive = (view) => view !== null && (view.countdown !== null || ["autonomous", "assisted"].includes(view.mode));

async function hold() {
  if (!navigator.wakeLock || lock || asks || !isSeen() || performance.now() - triedAt < RETRY_MS) return;
  [asks, triedAt] = [true, performance.now()];
  try {
    const got = await navigator.wakeLock.request("screen");
    [lock, refused] = [got, false];
    got.addEventListener("release", () => lock === got && (lock = null));
    if (!wanted) letGo();
  } catch {
    refused = true;
  }
  asks = false;
}

function letGo() {
  lock?.release().catch(() => {});
  lock = null;
}

function want(drives) {
  wanted = drives;
  if (wanted) hold();
  else letGo();
}

/** Says that the drive ended because this page was out of sight, once that is known, until the next drive. */
function sayWhy(view) {
  if (view.waits || (inDrive(view) && backAt === null)) setText($("slept"), "");
  if (backAt === null) return;
  if (!inDrive(view)) {
    if (view.unseen) {
      setText(
        $("slept"),
        "The drive ended because this page was out of sight: the screen went off, or another page was in front. Choose the place again, and keep this page in view.",
      );
    }
    backAt = null;
  } else if (performance.now() - backAt > OLD_VIEWS_MS) {
    backAt = null;
  }
}

on("view", (view) => {
  want(inDrive(view));
  $("awake").hidden = !refused || !(view.waits || wanted);
  if (isSeen()) sayWhy(view);
  $("slept").hidden = !$("slept").textContent;
});
on("state", (state) => state !== "open" && want(false));

document.addEventListener("visibilitychange", () => {
  if (!isSeen()) {
    if (inDrive(now.view)) leftAt = performance.now();
    return;
  }
  triedAt = -Infinity;
  if (wanted) hold();
  if (leftAt > -Infinity) [leftAt, backAt] = [-Infinity, performance.now()];
});
