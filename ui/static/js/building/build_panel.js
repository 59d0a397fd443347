// The panel Build: forms for new storeys, lifts, nodes, sub-maps and zones.

import { addNode, deleteSelected, submapHere } from "./actions.js";
import { fill } from "./forms.js";
import { edit, mapFolders, model, nodesOf, parentOf, post, say, titleOf } from "./model.js";
import { $, DEGREES, KINDS, RULES, fail, made, round } from "./panel_parts.js";
import { select, showAgain, shown } from "./state.js";

const HEIGHT_M = 3.5; // of a storey that nobody has measured yet
const LIFT_NAMES = /lift|elevator|aufzug|ascenseur|ascensor/i;

let maps = [];
const used = new Set(); // map folders that storeys were made of on this page

export async function findMaps() {
  maps = await mapFolders();
  showBuild();
}

const titled = (id) => id.charAt(0).toUpperCase() + id.slice(1).replaceAll(/[-_]/g, " ");
const idOf = (folder) => (folder.split("/").at(-1) || "").replaceAll(/[^\w.-]/g, "-");

const freeMaps = () => maps.filter((each) => !used.has(each) && !model.storeys.some(({ id }) => id === idOf(each)));

function storeyForm() {
  const free = freeMaps();
  const first = free[0] ?? "";
  const id = idOf(first) || `s${model.storeys.length}`;
  const heights = model.storeys.map(({ height }) => height);
  return made({
    key: "storey",
    title: "Add a storey",
    text: maps.length ? "" : "No map folders are beside this building's folder: put one there to build on it.",
    fields: [
      {
        key: "map", label: "Map", wide: true, value: first, choices: [...free.map((each) => [each, each]), ["", "no map"]],
        heard: (value, inputs) => {
          inputs.id.value = idOf(value) || id;
          inputs.name.value = titled(inputs.id.value);
        },
      },
      { key: "id", label: "Id", value: id },
      { key: "name", label: "Name", value: titled(id) },
      { key: "height", label: "Height, m", type: "number", value: heights.length ? round(Math.max(...heights) + HEIGHT_M) : 0 },
      { key: "graph", label: "Make its graph", type: "check", value: Boolean(first) },
    ],
    buttons: [{
      label: "Add this storey", main: true,
      run: async ({ map, id, name, height, graph }) => {
        const answer = await post("storey", { op: { do: "add_storey", id, name, height: height ?? 0, map } });
        if (!answer.done) return;
        used.add(map);
        select("storey", id);
        showBuild();
        if (graph && map) await generate(id);
      },
    }],
  });
}

export async function generate(storey) {
  say("The graph is being made from the map. This takes some seconds.");
  await post("generate", { storey });
}

function liftForm() {
  if (model.storeys.length < 2) return null;
  const ids = new Set(model.lifts.map(({ id }) => id));
  const id = [..."ABCDEFGHIJKLMNOPQRSTUVWXYZ"].find((each) => !ids.has(each)) ?? "L1";
  const fields = [{ key: "id", label: "Id", value: id }, { key: "name", label: "Name", value: `Lift ${id}` }];
  const taken = new Set(model.lifts.flatMap(({ stops }) => stops.map(({ at }) => at)));
  for (const storey of model.storeys) {
    const places = nodesOf(storey.id).filter(({ kind, ref }) => (kind === "end" || kind === "lift") && !taken.has(ref));
    const likely = places.find(({ name }) => LIFT_NAMES.test(name));
    const choices = [["", "does not stop"], ...places.map(({ ref, name }) => [ref, name || ref])];
    fields.push({ key: `at ${storey.id}`, label: `Stop on ${storey.name || storey.id}`, wide: true, value: likely?.ref ?? "", choices });
  }
  return made({
    key: "lift",
    title: "Join storeys by a lift",
    text: "Choose the place in front of its door on each storey. The maps are laid on each other, and the cabins looked for.",
    fields,
    buttons: [{
      label: "Join by this lift", main: true,
      run: async ({ id, name, ...stops }) => {
        const at = Object.values(stops).filter(Boolean);
        if (at.length < 2) fail("A lift needs stops on two storeys: choose them.");
        else if ((await post("lift", { op: { do: "set_lift", id, name }, stops: at })).done) select("lift", id);
      },
    }],
  });
}

function nodeForm() {
  if (!shown.storey) return null;
  return made({
    key: "node",
    title: "Add a node at the cross",
    text: `It goes into ${titleOf(submapHere()) || "the building"}.`,
    fields: [{ key: "kind", label: "Kind", choices: KINDS, value: "end" }, { key: "name", label: "Name" }],
    buttons: [{ label: "Add this node", run: ({ kind, name }) => addNode(kind, name) }],
  });
}

function submapForm() {
  const path = submapHere();
  const children = model.paths.filter((each) => each && parentOf(each) === path).map((each) => each.split("/").at(-1));
  let number = 1;
  while (children.includes(`r${number}`)) number += 1;
  return made({
    key: "submap",
    title: shown.marked.size ? `Make a room of ${shown.marked.size} marked nodes` : "Add a sub-map",
    text: shown.marked.size ? "" : `It goes below ${titleOf(path) || "the building"}.`,
    fields: [{ key: "id", label: "Id", value: `r${number}` }, { key: "name", label: "Name", value: `Room ${number}` },
      ...(shown.marked.size ? [] : [{ key: "storey", label: "Lies on", wide: true, choices: [["", "the same storey"], ...model.storeys.map((each) => [each.id, each.name || each.id])] }])],
    buttons: [{
      label: shown.marked.size ? "Make this room" : "Add this sub-map",
      run: async ({ id, name, storey = "" }) => {
        const nodes = [...shown.marked];
        const op = nodes.length ? { do: "split_submap", nodes, id, name } : { do: "add_submap", parent: path, id, name, storey };
        if (await edit(op)) select("submap", path ? `${path}/${id}` : id);
      },
    }],
  });
}

const cornersText = (polygon) => polygon.map(([x, y]) => `${round(x)} ${round(y)}`).join(", ");

function cornersOf(text) {
  const corners = text.split(",").map((pair) => pair.trim().split(/\s+/).map(Number));
  if (corners.some((pair) => pair.length !== 2 || pair.some(Number.isNaN))) throw new Error("Write corners as: 1 2, 3 2, 3 4.");
  if (corners.length !== 2) return corners;
  const [[x1, y1], [x2, y2]] = corners;
  return [[x1, y1], [x2, y1], [x2, y2], [x1, y2]];
}

export function zoneForm(zone = null) {
  const { rule = "keep_out", value = 0, polygon = shown.corners, name = "" } = zone ?? {};
  if (!model.drawn[shown.storey] || (!zone && !polygon.length)) return null;
  return made({
    key: "zone",
    title: zone ? `Zone ${name}` : "Make a zone",
    fields: [
      { key: "name", label: "Name", value: name || `zone ${model.drawn[shown.storey].zones.length + 1}` },
      { key: "rule", label: "Rule", choices: RULES, value: rule },
      { key: "value", label: "Fastest, m/s, or heading, degrees", type: "number", value: rule === "one_way" ? round(value * DEGREES, 1) : value || "" },
      { key: "corners", label: "Corners: x y, x y, ...", wide: true, value: cornersText(polygon) },
    ],
    buttons: [
      {
        label: zone ? "Change this zone" : "Make this zone", main: true,
        run: async ({ name: next, rule: chosen, value: number, corners }) => {
          const op = {
            do: "set_zone", storey: shown.storey, name: next, rule: chosen, polygon: cornersOf(corners),
            value: chosen === "keep_out" ? 0 : chosen === "slow" ? number ?? 0.3 : (number ?? 0) / DEGREES,
          };
          if (!(await edit(op))) return;
          if (zone && next !== zone.name) await edit({ do: "delete_zone", storey: shown.storey, name: zone.name });
          shown.corners = [];
          select("zone", next);
        },
      },
      zone
        ? { label: "Delete", bad: true, run: deleteSelected }
        : { label: "Forget the corners", run: () => { shown.corners = []; showAgain(); } },
    ],
  });
}

function buildingForm() {
  const fields = Object.entries(model.costs).map(([key, value]) => ({
    key, label: key.replace(/_m(ps)?$/, "").replaceAll("_", " ") + (key.endsWith("mps") ? ", m/s" : ", m"), type: "number", value,
  }));
  return made({
    key: "building",
    title: "The building",
    fields: [{ key: "name", label: "Name", wide: true, value: model.name }, ...fields],
    buttons: [{
      label: "Change the building",
      run: ({ name, ...costs }) => edit({ do: "change_building", name, costs: Object.fromEntries(Object.entries(costs).filter(([, each]) => each !== null)) }),
    }],
  });
}

export function showBuild() {
  const storeys = [storeyForm(), liftForm()];
  if (model.storeys.length && !freeMaps().length) storeys.reverse(); // the next thing to do first
  fill($("build"), ...storeys, nodeForm(), submapForm(), zoneForm(), buildingForm());
}
