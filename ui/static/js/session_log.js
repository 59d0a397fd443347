// The record of guided drives for a mobility trainer: yes, no, look, take away, erase; one press each. It stays on the chair.

import { headers } from "./stop.js";
import { $, element, note, setText } from "./page.js";
import { onTab } from "./tabs.js";

const MOST_ROWS = 12;
const HEADS = ["Day", "Goal", "Minutes", "Metres", "Touches", "Held back", "Symbols", "Not felt"];

async function asked(path, method = "GET") {
  const found = await fetch(`api/session_log${path}`, { method, headers: headers() }).catch(() => null);
  return found?.ok ? found : null;
}

const row = (each) => [
  each.day,
  each.arrived ? each.goal : `${each.goal} (not reached)`,
  (each.seconds / 60).toFixed(1),
  each.distance_m.toFixed(0),
  each.touches ?? "\u2013",
  `${each.caps} times, ${each.capped_s.toFixed(0)} s`,
  each.symbols,
  each.unfelt,
];

async function look() {
  const known = await (await asked(""))?.json();
  $("session-log").hidden = !known;
  if (!known) return;
  $("session-log-yes").setAttribute("aria-pressed", String(known.wanted));
  setText($("session-log-state"), known.trouble || (known.wanted ? "Your guided drives are recorded." : "Nothing is recorded."));
  const cells = known.drives.slice(-MOST_ROWS).map(row);
  const head = element("tr", {}, ...HEADS.map((text) => element("th", { scope: "col", textContent: text })));
  const body = cells.map((values) => element("tr", {}, ...values.map((value) => element("td", { textContent: String(value) }))));
  $("session-log-table").replaceChildren(
    ...(cells.length ? [element("table", { className: "cells" }, element("thead", {}, head), element("tbody", {}, ...body))] : []),
  );
}

async function change(what) {
  const found = await asked(`/${what}`, "POST");
  const { sentence } = found ? await found.json() : { sentence: "The chair did not answer: load the page again." };
  note(sentence, Boolean(found));
  look();
}

onTab((name) => name === "haptics" && look());
$("session-log-yes").addEventListener("click", () => change($("session-log-yes").getAttribute("aria-pressed") === "true" ? "no" : "yes"));
$("session-log-erase").addEventListener("click", () => change("erase"));
$("session-log-take").addEventListener("click", async () => {
  const found = await asked(".csv");
  if (!found) return;
  const link = element("a", { href: URL.createObjectURL(await found.blob()), download: "guided_drives.csv" });
  link.click();
  URL.revokeObjectURL(link.href);
});
