// The goals of a building as menus: storey, wing and room as the assistant named and ordered them, at most seven items each.

export const MOST = 7; // items of a menu beside "Back": spec of the source system, and a short sweep

/**
 * The items of a menu of goals. A goal is {name, path, ...}; `path` are the names from the storey to the goal itself. An item is
 * {label, goal} or {label, items}. A group with one item is that item; a group with more than `MOST` items is split in order.
 */
export function goalItems(goals) {
  return chunked(merged(grouped(goals, 0)));
}

function grouped(goals, depth) {
  const groups = new Map(); // a Map keeps the order of the goals
  for (const goal of goals) {
    const last = depth >= goal.path.length - 1;
    const key = last ? `goal ${goal.name}` : `group ${goal.path[depth]}`;
    if (!groups.has(key)) groups.set(key, { label: last ? goal.path.at(-1) : goal.path[depth], goal: last ? goal : null, goals: [] });
    groups.get(key).goals.push(goal);
  }
  return [...groups.values()].map(({ label, goal, goals: inner }) =>
    goal ? { label, goal } : { label, items: grouped(inner, depth + 1) },
  );
}

/** A group with one item becomes this item; the only group of a menu becomes the menu. */
function merged(items) {
  const short = items.map((item) => {
    if (!item.items) return item;
    const inner = merged(item.items);
    return inner.length === 1 ? { ...inner[0], label: `${item.label}, ${inner[0].label}` } : { ...item, items: inner };
  });
  return short.length === 1 && short[0].items ? short[0].items : short;
}

/** Menus with more than `MOST` items are split into groups of consecutive ones: about as many groups as items in each. */
function chunked(items) {
  const deep = items.map((item) => (item.items ? { ...item, items: chunked(item.items) } : item));
  if (deep.length <= MOST) return deep;
  const levels = Math.ceil(Math.log(deep.length) / Math.log(MOST) - 1e-9);
  const count = Math.min(MOST, Math.ceil(deep.length ** (1 / levels)));
  const groups = [];
  for (let k = 0; k < count; k += 1) {
    const part = deep.slice(Math.round((k * deep.length) / count), Math.round(((k + 1) * deep.length) / count));
    groups.push(part.length === 1 ? part[0] : { label: `${part[0].label} to ${part.at(-1).label}`, items: chunked(part) });
  }
  return groups;
}

/** A goal's time and lifts in words: "6 min, one lift"; empty where neither is known. */
export function effort({ seconds, lifts }) {
  if (seconds === null || seconds === undefined) return "";
  const time = seconds < 60 ? "less than a minute" : `${Math.round(seconds / 60)} min`;
  const words = ["", ", one lift", ", two lifts", ", three lifts"];
  return time + (words[lifts ?? 0] ?? `, ${lifts} lifts`);
}

/** The goals nearest to the chair, at most `most`: by driving time where it is known, else in a straight line. */
export function nearest(goals, pose, most) {
  const far = (goal) => goal.seconds ?? (goal.pose && pose ? Math.hypot(goal.pose[0] - pose[0], goal.pose[1] - pose[1]) : Infinity);
  return goals
    .map((goal) => [far(goal), goal])
    .filter(([distance]) => Number.isFinite(distance))
    .sort(([a], [b]) => a - b)
    .slice(0, most)
    .map(([, goal]) => goal);
}
