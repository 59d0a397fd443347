// What the buttons, the keys of the map and the switch do at the cross and to the selected thing.

import { moveCross, thingAtCross } from "./canvas.js";
import { arcAt, edit, model, nodeAt, nodesOf, post, say } from "./model.js";
import { select, shown, showAgain } from "./state.js";

const selectedNode = () => (shown.selected?.kind === "node" ? nodeAt(shown.selected.ref) : null);

/** The sub-map into which a new node goes: that of the selected thing on this storey, else that of the node nearest to the cross. */
export function submapHere() {
  const { kind, ref } = shown.selected ?? {};
  const path = kind === "submap" ? ref : kind === "node" ? nodeAt(ref)?.path : kind === "arc" ? arcAt(ref)?.path : null;
  if (path && model.submaps[path]?.storey === shown.storey) return path;
  const [x, y] = shown.cross;
  let [best, found] = [Infinity, null];
  for (const node of nodesOf(shown.storey)) {
    const far = Math.hypot(node.x - x, node.y - y);
    if (node.kind !== "door" && far < best) [best, found] = [far, node.path];
  }
  return found ?? model.paths.find((each) => model.submaps[each]?.own === shown.storey) ?? "";
}

export function selectAtCross() {
  const found = thingAtCross();
  if (!found) {
    say("Nothing is at the cross.", false);
    select(null);
    return;
  }
  select(found.kind, found.ref);
  say(found.kind === "node" ? nodeSentence(nodeAt(found.ref)) : `Arc ${found.ref}.`);
}

const KINDS = { end: "Goal", cross: "Cross node", door: "Door", lift: "Lift stop" };

export const nodeSentence = ({ ref, kind, name }) => `${KINDS[kind]} ${name || ref}${name ? `, ${ref}` : ""}.`;

/** Adds a node at the cross; in a chain it is joined to the selected one. */
export async function addNode(kind = "cross", name = "") {
  const submap = submapHere();
  if (!shown.storey) {
    say("Add a storey first.", false);
    return;
  }
  const from = selectedNode();
  const joined = shown.chain && from ? [from.ref] : [];
  const before = new Set(model.submaps[submap]?.nodes.map(([id]) => id));
  const [x, y] = shown.cross;
  if (!(await edit({ do: "add_node", submap, x, y, kind, name, joined }))) return;
  const made = model.submaps[submap].nodes.find(([id]) => !before.has(id));
  select("node", `${submap}:${made[0]}`);
  say(`Added ${made[0]}${joined.length ? `, joined to ${joined[0]}` : ""}.`);
}

/** Joins the selected node to the one at the cross. */
export async function joinAtCross() {
  const from = selectedNode();
  const to = thingAtCross(from?.ref);
  if (!from || to?.kind !== "node") {
    say("Select a node, then put the cross on another one.", false);
    return;
  }
  if (await edit({ do: "join", one: from.ref, other: to.ref })) say(`Joined ${from.ref} and ${to.ref}.`);
}

export async function moveToCross() {
  const nodes = shown.marked.size ? [...shown.marked] : selectedNode() ? [shown.selected.ref] : [];
  if (!nodes.length) {
    say("Select or mark a node first.", false);
    return;
  }
  const first = selectedNode() && nodes.includes(shown.selected.ref) ? selectedNode() : nodeAt(nodes[0]);
  const [x, y] = [shown.cross[0] - first.x, shown.cross[1] - first.y];
  if (await edit({ do: "move_nodes", nodes, x, y })) say(`Moved ${nodes.length === 1 ? nodes[0] : `${nodes.length} nodes`}.`);
}

export async function deleteSelected() {
  const { kind, ref } = shown.selected ?? {};
  const marked = [...shown.marked];
  const ops = {
    node: { do: "delete_nodes", nodes: [ref] },
    arc: { do: "delete_arcs", arcs: [ref] },
    submap: { do: "delete_submap", path: ref },
    lift: { do: "delete_lift", id: ref },
    storey: { do: "delete_storey", id: ref },
    zone: { do: "delete_zone", storey: shown.storey, name: ref },
    place: { do: "delete_place", storey: shown.storey, name: ref },
  };
  const op = marked.length ? { do: "delete_nodes", nodes: marked } : ops[kind];
  if (!op) {
    say("Select something to delete first.", false);
    return;
  }
  if (await edit(op)) say("Deleted. Undo brings it back.");
}

export function mark() {
  const found = thingAtCross();
  const ref = found?.kind === "node" ? found.ref : selectedNode()?.ref;
  if (!ref) {
    say("Put the cross on a node, or select one.", false);
    return;
  }
  if (!shown.marked.delete(ref)) shown.marked.add(ref);
  say(`${shown.marked.size} nodes marked.`);
  showAgain();
}

export function setCorner() {
  shown.corners.push([...shown.cross]);
  say(`${shown.corners.length} corners set. ${shown.corners.length < 3 ? "Two make a rectangle." : "Make the zone under Build."}`);
  showAgain();
}

export function toggleChain() {
  shown.chain = !shown.chain;
  say(shown.chain ? "Each new node is joined to the selected one." : "New nodes are not joined.");
  showAgain();
}

/** Goes to the next or previous node of the storey. */
export function step(by) {
  const nodes = nodesOf(shown.storey);
  if (!nodes.length) return;
  const at = nodes.findIndex(({ ref }) => ref === shown.selected?.ref);
  const next = nodes[(at + by + nodes.length) % nodes.length] ?? nodes[0];
  select("node", next.ref, true);
  say(nodeSentence(next));
}

/** Drives an arc in the simulator. */
export async function drive(arc) {
  say("A simulated chair drives this arc. This takes a while; you can go on.");
  await post("drive", { arc });
}

export { moveCross };
