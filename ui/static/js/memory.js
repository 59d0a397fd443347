// Values that this browser keeps for the page. Where it keeps nothing, because storage is blocked, full or damaged, they last
// until the page is left.

const held = new Map();

/** A kept value as text, null without one. */
export function recall(name) {
  if (held.has(name)) return held.get(name);
  try {
    return localStorage.getItem(name) ?? null;
  } catch {
    return null;
  }
}

/** Keeps a value as text. */
export function remember(name, value) {
  held.set(name, value);
  try {
    localStorage.setItem(name, value);
  } catch {
    // the page's options say so
  }
}

/** A kept list of texts; without the parts that are damaged. */
export function recallList(name) {
  try {
    const found = JSON.parse(recall(name) ?? "[]");
    return Array.isArray(found) ? found.filter((each) => typeof each === "string") : [];
  } catch {
    return [];
  }
}

/** Whether this browser keeps values. */
export function remembers() {
  const probe = "probe";
  try {
    localStorage.setItem(probe, probe);
    const kept = localStorage.getItem(probe) === probe;
    localStorage.removeItem(probe);
    return kept;
  } catch {
    return false;
  }
}
