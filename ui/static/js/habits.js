// The rider's own record: yes, no, look, take away, erase; one press each. It stays on the chair.

import { headers } from "./stop.js";
import { $, element, note, setText } from "./page.js";
import { onTab } from "./tabs.js";

const MOST_ROWS = 12;

async function asked(path, method = "GET") {
  const found = await fetch(`api/habits${path}`, { method, headers: headers() }).catch(() => null);
  return found?.ok ? found : null;
}

async function look() {
  const known = await (await asked(""))?.json();
  $("habits").hidden = !known;
  if (!known) return;
  const { wanted, trouble, drives, places } = known;
  $("habits-yes").setAttribute("aria-pressed", String(wanted));
  setText($("habits-state"), trouble || (wanted ? "Your drives are remembered on this chair." : "Nothing is remembered."));
  $("habits-table").replaceChildren(
    ...table("Latest drives", ["Day", "Goal", "Minutes", "By the graph", "Stops", "Prompts"], drives.slice(-MOST_ROWS).map(drive)),
    ...table("Places", ["Place", "Right", "Others", "Prompts now"], places.map(({ name, right, other, level }) => [name, right, other, level])),
  );
}

const drive = ({ day, goal, seconds, expected_s, stops, prompts }) => [day, goal, minutes(seconds), minutes(expected_s), stops, prompts];

const minutes = (seconds) => (seconds / 60).toFixed(1);

function table(caption, heads, rows) {
  if (!rows.length) return [];
  const head = element("tr", {}, ...heads.map((text) => element("th", { scope: "col", textContent: text })));
  const body = rows.map((row) => element("tr", {}, ...row.map((value) => element("td", { textContent: String(value) }))));
  return [element("table", {}, element("caption", { textContent: caption }), element("thead", {}, head), element("tbody", {}, ...body))];
}

async function change(what, done) {
  const found = await asked(`/${what}`, "POST");
  const { sentence } = found ? await found.json() : { sentence: "The chair did not answer: load the page again." };
  note(sentence || done, Boolean(found));
  look();
}

onTab((name) => name === "options" && look());
$("habits-yes").addEventListener("click", () => {
  const yes = $("habits-yes").getAttribute("aria-pressed") === "true";
  change(yes ? "no" : "yes", yes ? "Nothing more is remembered" : "Your drives are remembered on this chair");
});
$("habits-erase").addEventListener("click", () => change("erase", "Everything was erased"));
$("habits-take").addEventListener("click", async () => {
  const found = await asked(".csv");
  if (!found) return;
  const link = element("a", { href: URL.createObjectURL(await found.blob()), download: "habits.csv" });
  link.click();
  URL.revokeObjectURL(link.href);
});
