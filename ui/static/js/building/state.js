// What this page shows of the building: storey, cross, selected thing, marked nodes, corners of a zone.

import { arcAt, model, nodeAt, on } from "./model.js";

const CHANGED = new EventTarget();

export const shown = {
  storey: "",
  cross: [0, 0], // in the storey's map [m]
  selected: null, // {kind, ref}
  marked: new Set(), // addresses of nodes
  corners: [],
  chain: false,
};

/** Registers a listener for changes of what is shown. */
export const onShown = (heard) => CHANGED.addEventListener("change", heard);
export const showAgain = () => CHANGED.dispatchEvent(new Event("change"));

/** Selects a thing by kind and address, null for nothing; goes to its storey. */
export function select(kind, ref = "", move = false) {
  shown.selected = kind ? { kind, ref } : null;
  const thing = kind === "node" ? nodeAt(ref) : kind === "arc" ? arcAt(ref) : null;
  const storey = kind === "submap" ? model.submaps[ref]?.storey : kind === "storey" ? ref : thing?.storey;
  if (storey && storey !== shown.storey) shown.storey = storey;
  const at = move && placeOf(shown.selected);
  if (at) shown.cross = at;
  showAgain();
}

/** Where a thing is in its storey's map [m]; null for things without a place. */
export function placeOf(selected) {
  if (selected?.kind === "node") {
    const node = nodeAt(selected.ref);
    return node && [node.x, node.y];
  }
  if (selected?.kind === "arc") {
    const ends = arcAt(selected.ref)?.ends.map(nodeAt) ?? [];
    return ends.length === 2 && ends.every(Boolean) ? [(ends[0].x + ends[1].x) / 2, (ends[0].y + ends[1].y) / 2] : null;
  }
  if (selected?.kind === "submap") {
    const nodes = model.submaps[selected.ref]?.nodes ?? [];
    return nodes.length ? [2, 3].map((at) => nodes.reduce((sum, node) => sum + node[at], 0) / nodes.length) : null;
  }
  return null;
}

/** The thing that a finding's place stands for: {kind, ref}; null for none. */
export function thingAt(place) {
  if (place.startsWith("storey ")) return { kind: "storey", ref: place.slice(7) };
  if (place.startsWith("lift ")) return { kind: "lift", ref: place.slice(5) };
  if (place.includes(">")) return arcAt(place) && { kind: "arc", ref: arcAt(place).ref };
  if (place.includes(":")) return nodeAt(place) && { kind: "node", ref: place };
  return place in model.submaps ? { kind: "submap", ref: place } : null;
}

/** Leaves out what is not there any more. */
function tidy() {
  if (!model.storeys.some(({ id }) => id === shown.storey)) shown.storey = model.storeys[0]?.id ?? "";
  for (const ref of shown.marked) if (!nodeAt(ref)) shown.marked.delete(ref);
  const { kind, ref } = shown.selected ?? {};
  const there = {
    node: () => nodeAt(ref),
    arc: () => arcAt(ref),
    submap: () => ref in model.submaps,
    storey: () => model.storeys.some(({ id }) => id === ref),
    lift: () => model.lifts.some(({ id }) => id === ref),
    zone: () => model.drawn[shown.storey]?.zones.some(({ name }) => name === ref),
    place: () => ref in (model.drawn[shown.storey]?.places ?? {}),
  };
  if (kind && !there[kind]?.()) shown.selected = null;
}

on("change", tidy); // before the listeners of the modules that show it
