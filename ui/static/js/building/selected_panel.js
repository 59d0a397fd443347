// The panel of the selected thing: its form, and lists of the things that belong to it.

import { addNode, deleteSelected, drive } from "./actions.js";
import { generate, zoneForm } from "./build_panel.js";
import { element, fill } from "./forms.js";
import { arcAt, arcsOf, edit, model, nodeAt, nodesOf, parentOf, post, titleOf } from "./model.js";
import { $, DEGREES, KINDS, MOST_LISTED, RULES, list, made, round } from "./panel_parts.js";
import { select, showAgain, shown } from "./state.js";

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

export function showSelected() {
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
