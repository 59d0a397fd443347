// The panels beside the map: their tabs, the checks, the parts and the file.

import { showBuild } from "./build_panel.js";
import { element, fill } from "./forms.js";
import { download, importFile, model, nodesOf, on, post, say, titleOf } from "./model.js";
import { $, MOST_LISTED, list, made } from "./panel_parts.js";
import { showSelected } from "./selected_panel.js";
import { onShown, select, thingAt } from "./state.js";

// Faults

function showFaults() {
  const findings = [...model.findings].sort((a, b) => (a.severity === "warning") - (b.severity === "warning"));
  $("faults-none").hidden = findings.length > 0;
  const items = findings.slice(0, MOST_LISTED).map(({ code, severity, place, sentence, remedy }) => {
    const button = element("button", { type: "button", className: severity, data: { scan: "", ref: `${code} ${place}`, code } },
      element("b", { textContent: `${severity === "error" ? "▲" : "△"} ${code} ${severity}` }), sentence, element("i", { textContent: `Remedy: ${remedy}.` }));
    button.addEventListener("click", () => {
      const thing = thingAt(place);
      if (thing) {
        select(thing.kind, thing.ref, true);
        showTab("selected");
        $("selected").querySelector("button, input, select")?.focus();
      } else say(`${sentence}: ${remedy}.`);
    });
    return element("li", {}, button);
  });
  fill($("faults-list"), ...items);
  const errors = findings.filter(({ severity }) => severity === "error").length;
  $("tab-faults").textContent = findings.length ? `Checks (${errors} errors, ${findings.length - errors} warnings)` : "Checks";
}

// Parts and file

let wanted = "";

function showParts() {
  const folded = wanted.toLowerCase();
  const things = [
    ...model.storeys.map(({ id, name }) => ({ kind: "storey", ref: id, text: `Storey ${name || id}` })),
    ...model.lifts.map(({ id, name }) => ({ kind: "lift", ref: id, text: name || `Lift ${id}` })),
    ...model.paths.map((path) => ({ kind: "submap", ref: path, text: path ? `${titleOf(path)}, ${path}` : "The whole building" })),
    ...(folded ? model.storeys.flatMap(({ id }) => nodesOf(id)).map(({ ref, name }) => ({ kind: "node", ref, text: name ? `${name}, ${ref}` : ref })) : []),
  ].filter(({ text }) => text.toLowerCase().includes(folded));
  const items = things.slice(0, MOST_LISTED).map(({ kind, ref, text }) => ({
    text, ref: `${kind} ${ref}`,
    pressed: () => {
      select(kind, ref, true);
      showTab("selected");
      $("selected").querySelector("button, input, select")?.focus();
    },
  }));
  fill($("parts"), made({
    key: "find", title: "Find a part", fields: [{ key: "text", label: "Name or address", wide: true, value: wanted }],
    buttons: [{ label: "Find", run: ({ text }) => { wanted = text.trim(); showParts(); } }],
  }), list("Parts", items));
}

function showFile() {
  const file = element("input", { type: "file", ariaLabel: "File to import", data: { field: "file", scan: "" } });
  file.addEventListener("change", () => file.files[0] && importFile(file.files[0]));
  fill(
    $("file"),
    made({
      key: "draft", title: "Draft",
      text: model.saved ? "The saved building is what you see." : `Not saved yet. ${model.blocked ? `${model.blocked} errors keep it a draft.` : "It can be saved."}`,
      buttons: [
        { label: "Save the building", main: true, run: save },
        { label: "Give the draft up", bad: true, run: () => post("discard") },
        { label: "Make route tables", run: () => post("tables") },
      ],
    }),
    made({
      key: "export", title: "Export",
      fields: [{ key: "format", label: "Format", choices: [["rmf", "Open-RMF building.yaml"], ["geojson", "Nav2 GeoJSON"], ["csv", "CSV files"]] }],
      buttons: [{ label: "Export", run: ({ format }) => download(format) }],
    }),
    element("form", { data: { scanGroup: "Import" } }, element("h3", { textContent: "Import" }),
      element("p", { className: "quiet", textContent: "An Open-RMF building.yaml or a Nav2 GeoJSON takes the place of this draft. Undo brings the draft back." }), file),
  );
}

export async function save() {
  const answer = await post("save");
  if (answer.done && !model.saved) showTab("faults");
}

// Tabs (WAI-ARIA Authoring Practices)

const tabs = [...document.querySelectorAll("[role=tab]")];

export function showTab(name, focus = false) {
  for (const tab of tabs) {
    const isShown = tab.getAttribute("aria-controls") === name;
    tab.setAttribute("aria-selected", String(isShown));
    tab.tabIndex = isShown ? 0 : -1;
    $(tab.getAttribute("aria-controls")).hidden = !isShown;
    if (isShown && focus) tab.focus();
  }
}

for (const [index, tab] of tabs.entries()) {
  tab.addEventListener("click", () => showTab(tab.getAttribute("aria-controls")));
  tab.addEventListener("keydown", ({ key }) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[key];
    if (step) showTab(tabs[(index + step + tabs.length) % tabs.length].getAttribute("aria-controls"), true);
  });
}

function showAll() {
  showFaults();
  showBuild();
  showSelected();
  showParts();
  showFile();
}

on("change", showAll);
onShown(() => {
  showBuild();
  showSelected();
});
