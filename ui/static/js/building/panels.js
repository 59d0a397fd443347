// The panels beside the map: storeys and lifts to build, faults, the selected thing's form, the parts, the file.

import { addNode, deleteSelected, drive, submapHere } from "./actions.js";
import { element, fill, form } from "./forms.js";
import {
  arcAt, arcsOf, download, edit, importFile, mapFolders, model, nodeAt, nodesOf, on, parentOf, post, say, titleOf,
} from "./model.js";
import { onShown, placeOf, select, shown, showAgain, thingAt } from "./state.js";

const $ = (id) => document.getElementById(id);
const DEGREES = 180 / Math.PI;
const MOST_LISTED = 200;
const HEIGHT_M = 3.5; // of a storey that nobody has measured yet
const KINDS = [["end", "goal"], ["cross", "cross"], ["door", "door"], ["lift", "lift stop"]];
const RULES = [["keep_out", "keep out"], ["slow", "slow"], ["one_way", "one way"]];
const LIFT_NAMES = /lift|elevator|aufzug|ascenseur|ascensor/i;

const fail = (sentence) => say(sentence, false);
const round = (value, digits = 3) => (value === null || value === undefined ? "" : String(Number(value.toFixed(digits))));
const made = (settings) => form(settings, fail);
const list = (title, things) =>
  element("ul", { className: "list", ariaLabel: title, data: { scanGroup: title } }, ...things.map(({ text, pressed, ref }) => {
    const button = element("button", { type: "button", textContent: text, data: { scan: "", ref } });
    button.addEventListener("click", pressed);
    return element("li", {}, button);
  }));

let maps = [];
const used = new Set(); // map folders that storeys were made of on this page

async function findMaps() {
  maps = await mapFolders();
  showBuild();
}

// Build: storeys, lifts, sub-maps, zones

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

async function generate(storey) {
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

function zoneForm(zone = null) {
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

function showBuild() {
  const storeys = [storeyForm(), liftForm()];
  if (model.storeys.length && !freeMaps().length) storeys.reverse(); // the next thing to do first
  fill($("build"), ...storeys, nodeForm(), submapForm(), zoneForm(), buildingForm());
}

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

// The selected thing

function nodeFormOf(ref) {
  const node = nodeAt(ref);
  const place = node.kind === "end" ? model.drawn[node.storey]?.places[node.name] : null;
  const others = nodesOf(node.storey)
    .filter(({ ref: other, path }) => other !== ref && (path === node.path || parentOf(path) === node.path || parentOf(node.path) === path || parentOf(path) === parentOf(node.path)))
    .map((other) => ({ ...other, far: Math.hypot(other.x - node.x, other.y - node.y) }))
    .sort((a, b) => a.far - b.far)
    .slice(0, 30);
  const near = others.map(({ ref: other, name, far }) => [other, `${name || other}, ${far.toFixed(1)} m`]);
  const arcs = arcsOf(node.storey).filter(({ ends }) => ends.includes(ref));
  return [
    made({
      key: "this node", title: `${node.name || node.id}`, text: `Node ${ref}, ${node.by === "auto" ? "made from the map" : "made by hand"}.`,
      fields: [
        { key: "name", label: "Name", wide: true, value: node.name },
        { key: "kind", label: "Kind", choices: KINDS, value: node.kind },
        { key: "id", label: "Id", value: node.id },
        { key: "x", label: "x, m", type: "number", value: round(node.x, 4) },
        { key: "y", label: "y, m", type: "number", value: round(node.y, 4) },
      ],
      buttons: [
        {
          label: "Change this node", main: true,
          run: async ({ name, kind, id, x, y }) => {
            const [dx, dy] = [(x ?? node.x) - node.x, (y ?? node.y) - node.y];
            if ((dx || dy) && !(await edit({ do: "move_nodes", nodes: [ref], x: dx, y: dy }))) return;
            if (name === node.name && kind === node.kind && id === node.id) return;
            if (await edit({ do: "change_node", node: ref, kind, name, id })) select("node", `${node.path}:${id}`);
          },
        },
        { label: "Delete", bad: true, run: deleteSelected },
        { label: "Split", run: () => edit({ do: "split_node", node: ref }) },
        { label: shown.marked.has(ref) ? "Take the mark off" : "Mark", run: () => { if (!shown.marked.delete(ref)) shown.marked.add(ref); showAgain(); } },
      ],
    }),
    near.length ? made({
      key: "join", title: "Join", fields: [{ key: "other", label: "To", choices: near, wide: true }, { key: "oneWay", label: "One way, from this node", type: "check" }],
      buttons: [
        { label: "Join these", run: ({ other, oneWay }) => edit({ do: "join", one: ref, other, one_way: oneWay }) },
        { label: "Make them one node", run: ({ other }) => edit({ do: "merge_nodes", kept: ref, gone: other }) },
      ],
    }) : null,
    place ? made({
      key: "place", title: "The place",
      fields: [
        { key: "theta", label: "Heading, degrees", type: "number", value: round(place[2] * DEGREES, 1) },
        { key: "near", label: "How near, m", type: "number", value: round(place[3]) },
        { key: "turn", label: "How straight, degrees", type: "number", value: round(place[4] * DEGREES, 1) },
      ],
      buttons: [{
        label: "Change the place",
        run: ({ theta, near: close, turn }) => edit({
          do: "set_place", storey: node.storey, name: node.name, x: place[0], y: place[1], theta: (theta ?? 0) / DEGREES, tolerance_m: close, tolerance_rad: turn === null ? null : turn / DEGREES,
        }),
      }],
    }) : null,
    model.lifts.length ? made({
      key: "stop", title: "Stop of a lift", fields: [{ key: "lift", label: "Lift", choices: model.lifts.map(({ id, name }) => [id, name || id]) }],
      buttons: [{ label: "The lift stops here", run: ({ lift }) => edit({ do: "set_stop", lift, at: ref }) }],
    }) : null,
    list("Its arcs", arcs.map((arc) => ({ text: `${arc.door ? "Doorway" : "Arc"} to ${arc.ends.find((each) => each !== ref)}`, ref: arc.ref, pressed: () => select("arc", arc.ref) }))),
  ];
}

function arcFormOf(chosen) {
  const arc = arcAt(chosen);
  const { ref } = arc;
  const [one, other] = arc.ends.map(nodeAt);
  const direction = !arc.oneWay ? "both" : arc.outwards ? "back" : "there";
  const far = one && other ? Math.hypot(one.x - other.x, one.y - other.y) : 0;
  return [made({
    key: "this arc", title: `${arc.door ? "Doorway" : "Arc"} ${arc.ends.join(" to ")}`, text: arc.door ? "" : `${far.toFixed(2)} m in a straight line.`,
    fields: [
      { key: "direction", label: "Driven", value: direction, choices: [["both", "both ways"], ["there", `to ${arc.ends[1]}`], ["back", `to ${arc.ends[0]}`]] },
      { key: "width", label: "Door's width, m", type: "number", value: round(arc.width) },
      { key: "speed", label: "Fastest, m/s", type: "number", value: round(arc.speed) },
      { key: "length", label: "Length, m", type: "number", value: round(arc.length) },
      { key: "drive_s", label: "Driving time, s", type: "number", value: round(arc.drive_s) },
      { key: "price", label: "Price, m", type: "number", value: round(arc.price) },
      { key: "closed", label: "Closed because", value: arc.closed ?? "" },
      { key: "until", label: "Closed until, UTC", value: arc.until ?? "" },
      { key: "ramp", label: "Ramp between storeys", type: "check", value: arc.ramp },
    ],
    buttons: [
      { label: "Change this arc", main: true, run: async (values) => (await edit({ do: "change_arc", arc: ref, ...values })) && select("arc", arcAt(ref).ref) },
      { label: "Delete", bad: true, run: deleteSelected },
      ...(arc.door ? [] : [
        { label: "Node in its middle", run: () => edit({ do: "split_arc", arc: ref }) },
        { label: "Node at the cross", run: () => edit({ do: "split_arc", arc: ref, x: shown.cross[0], y: shown.cross[1] }) },
      ]),
      { label: "Drive this arc", run: () => drive(ref) },
    ],
  }),
  crossingForm(ref),
  list("Its ends", arc.ends.map((end) => ({ text: end, ref: end, pressed: () => select("node", end, true) })))];
}

/** A form to put a node where an arc crosses others, if a check says that it does. */
function crossingForm(ref) {
  const path = ref.slice(0, ref.indexOf(":"));
  const sides = model.findings.filter(({ code, sentence }) => code === "E12" && sentence.includes(" cross") && sentence.includes(ref)).flatMap(({ place, sentence }) => [place, ...sentence.split(" ")]);
  const others = [...new Set(sides)].filter((each) => each !== ref && each.startsWith(`${path}:`) && arcAt(each));
  if (!others.length) return null;
  return made({
    key: "crossing", title: "Where it crosses another arc", fields: [{ key: "other", label: "Arc", wide: true, choices: others.map((each) => [each, each]) }],
    buttons: [{ label: "Put a node where they cross", run: ({ other }) => edit({ do: "cross_arcs", one: ref, other }) }],
  });
}

function submapFormOf(path) {
  const { name, frame, own, nodes, arcs, doors, beacons } = model.submaps[path];
  const inner = model.paths.filter((each) => each && parentOf(each) === path);
  return [
    path ? made({
      key: "this submap", title: titleOf(path), text: `Sub-map ${path}.`,
      fields: [
        { key: "name", label: "Name", wide: true, value: name },
        { key: "x", label: "x, m", type: "number", value: round(frame[0], 4) },
        { key: "y", label: "y, m", type: "number", value: round(frame[1], 4) },
        { key: "theta", label: "Turned, degrees", type: "number", value: round(frame[2] * DEGREES, 2) },
        { key: "scale", label: "Scale", type: "number", value: round(frame[3], 6) },
      ],
      buttons: [
        { label: "Change this sub-map", main: true, run: ({ theta, ...values }) => edit({ do: "change_submap", path, ...values, theta: (theta ?? 0) / DEGREES }) },
        ...(own === path ? [] : [
          { label: "Delete", bad: true, run: deleteSelected },
          { label: "Dissolve", run: () => edit({ do: "merge_submap", path }) },
        ]),
      ],
    }) : null,
    path && !own ? made({
      key: "move submap", title: "Its place in the tree", fields: [{ key: "to", label: "Path", wide: true, value: path }],
      buttons: [{ label: "Move or rename it", run: async ({ to }) => (await edit({ do: "move_submap", path, to })) && select("submap", to) }],
    }) : null,
    list("Rooms in it", inner.map((each) => ({ text: titleOf(each), ref: each, pressed: () => select("submap", each, true) }))),
    list("Its nodes", nodes.slice(0, MOST_LISTED).map(([id, kind, , , title]) => ({ text: `${title || id} (${kind})`, ref: `${path}:${id}`, pressed: () => select("node", `${path}:${id}`, true) }))),
    list("Its arcs and doorways", [...arcs, ...doors].slice(0, MOST_LISTED).map(({ ref }) => ({ text: ref, ref, pressed: () => select("arc", ref, true) }))),
    beaconForm(path, beacons),
  ];
}

function beaconForm(path, beacons) {
  return made({
    key: "beacon", title: "Beacons", text: beacons.map(({ id, node }) => `${id}${node ? ` at ${node}` : ""}`).join(", "),
    fields: [{ key: "id", label: "Number" }, { key: "x", label: "x, m", type: "number" }, { key: "y", label: "y, m", type: "number" }, { key: "theta", label: "Heading, degrees", type: "number" }, { key: "node", label: "Node" }],
    buttons: [
      { label: "Set this beacon", run: ({ id, x, y, theta, node }) => edit({ do: "set_beacon", submap: path, id, x: x ?? 0, y: y ?? 0, theta: (theta ?? 0) / DEGREES, node }) },
      { label: "Delete this beacon", run: ({ id }) => edit({ do: "delete_beacon", submap: path, id }) },
    ],
  });
}

function storeyFormOf(id) {
  const storey = model.storeys.find((each) => each.id === id);
  const zones = model.drawn[id]?.zones ?? [];
  const goals = new Set(nodesOf(id).map(({ name }) => name));
  const places = Object.keys(model.drawn[id]?.places ?? {}).filter((name) => !goals.has(name));
  return [
    made({
      key: "this storey", title: `Storey ${storey.name || id}`, text: storey.map ? `Its map is in ${storey.map}.` : "It has no map.",
      fields: [{ key: "name", label: "Name", value: storey.name }, { key: "height", label: "Height, m", type: "number", value: storey.height }],
      buttons: [
        { label: "Change this storey", main: true, run: ({ name, height }) => edit({ do: "change_storey", id, name, height: height ?? 0 }) },
        { label: "Make its graph from the map", run: () => generate(id) },
        { label: "Lay it on the others by its lifts", run: () => post("align", { storey: id }) },
        { label: "Delete", bad: true, run: deleteSelected },
      ],
    }),
    zones.length ? list("Zones", zones.map(({ name, rule }) => ({ text: `${name}: ${RULES.find(([key]) => key === rule)[1]}`, ref: name, pressed: () => select("zone", name) }))) : null,
    places.length ? list("Places that are no goals", places.map((name) => ({ text: name, ref: name, pressed: () => select("place", name) }))) : null,
  ];
}

function placeFormOf(name) {
  const [x, y] = model.drawn[shown.storey].places[name];
  return [made({
    key: "this place", title: `Place ${name}`, text: "It is no goal of the graph yet.",
    buttons: [
      { label: "Make it a goal", main: true, run: () => { shown.cross = [x, y]; return addNode("end", name); } },
      { label: "Delete", bad: true, run: deleteSelected },
    ],
  })];
}

function liftFormOf(id) {
  const lift = model.lifts.find((each) => each.id === id);
  const fields = [["cabin_width", "Cabin's width, m"], ["cabin_depth", "Cabin's depth, m"], ["door_width", "Door's width, m"], ["wait", "Waiting, m"], ["board", "Boarding, m"], ["per_storey", "A storey, m"]];
  return [
    made({
      key: "this lift", title: lift.name || `Lift ${id}`, text: "Costs are metres of driving; empty ones are the building's.",
      fields: [{ key: "name", label: "Name", wide: true, value: lift.name }, ...fields.map(([key, label]) => ({ key, label, type: "number", value: round(lift[key]) }))],
      buttons: [
        { label: "Change this lift", main: true, run: (values) => edit({ do: "set_lift", id, ...values }) },
        { label: "Delete", bad: true, run: deleteSelected },
      ],
    }),
    ...lift.stops.map((stop) => made({
      key: `stop ${stop.at}`, title: `Stop on ${stop.storey}, at ${stop.at}`,
      fields: [
        { key: "x", label: "Cabin's x, m", type: "number", value: round(stop.cabin?.[0]) },
        { key: "y", label: "Cabin's y, m", type: "number", value: round(stop.cabin?.[1]) },
        { key: "theta", label: "It faces, degrees", type: "number", value: stop.cabin ? round(stop.cabin[2] * DEGREES, 1) : "" },
        { key: "width", label: "Door's width, m", type: "number", value: round(stop.door_width) },
        { key: "closed", label: "Closed because", value: stop.closed },
      ],
      buttons: [
        {
          label: "Change this stop",
          run: ({ x, y, theta, width, closed }) => {
            const known = [x, y, theta].filter((each) => each !== null).length;
            if (known && known < 3) throw new Error("A cabin needs x, y and its direction: give all three, or none.");
            return edit({ do: "set_stop", lift: id, at: stop.at, door_width: width, closed, cabin: known ? [x, y, theta / DEGREES] : null });
          },
        },
        { label: "Find the cabin on the map", run: () => post("cabin", { lift: id, at: stop.at }) },
        { label: "Take this stop out", bad: true, run: () => edit({ do: "delete_stop", lift: id, at: stop.at }) },
      ],
    })),
  ];
}

function markedForm() {
  if (!shown.marked.size) return null;
  const nodes = [...shown.marked];
  return made({
    key: "marked", title: `${nodes.length} marked nodes`,
    fields: [{ key: "x", label: "Move by x, m", type: "number", value: 0 }, { key: "y", label: "by y, m", type: "number", value: 0 }],
    buttons: [
      { label: "Move them", run: ({ x, y }) => edit({ do: "move_nodes", nodes, x: x ?? 0, y: y ?? 0 }) },
      { label: "Take the marks off", run: () => { shown.marked.clear(); showAgain(); } },
      { label: "Delete them", bad: true, run: () => edit({ do: "delete_nodes", nodes }) },
    ],
  });
}

function showSelected() {
  const { kind, ref } = shown.selected ?? {};
  const forms = {
    node: () => nodeFormOf(ref),
    arc: () => arcFormOf(ref),
    submap: () => submapFormOf(ref),
    storey: () => storeyFormOf(ref),
    lift: () => liftFormOf(ref),
    zone: () => [zoneForm(model.drawn[shown.storey].zones.find(({ name }) => name === ref))],
    place: () => placeFormOf(ref),
  };
  const none = element("p", { className: "quiet", textContent: "Nothing is selected. Select on the map, under Parts, or under Checks." });
  fill($("selected"), markedForm(), ...(kind ? forms[kind]() : [none]));
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
export { findMaps, placeOf };
