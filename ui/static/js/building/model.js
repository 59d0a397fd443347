// The building as the server holds it: read once, then changed by the answers to edits, which are sent one after the other.

const CHANGED = new EventTarget();
const TOKEN = "#token=";
const NEWS_MS = 1000;

export const model = {
  revision: 0,
  name: "",
  folder: "",
  costs: {},
  storeys: [],
  lifts: [],
  paths: [],
  submaps: {}, // by path: {name, storey, frame, nodes, arcs, doors, beacons}
  drawn: {}, // places and zones by storey
  findings: [],
  undoes: "",
  redoes: "",
  saved: true,
  blocked: 0,
  foreign: [],
  chair: false, // whether a chair is served beside the editor
};

let token = sessionStorage.getItem("token") ?? "";
if (location.hash.startsWith(TOKEN)) useToken(decodeURIComponent(location.hash.slice(TOKEN.length)));

export function useToken(next) {
  token = next;
  sessionStorage.setItem("token", token);
  history.replaceState(null, "", location.pathname);
}

export const headers = () => (token ? { authorization: `Bearer ${token}` } : {});

/** Registers a listener: "change" after every answer, "said" for sentences {sentence, good}, "token" where one is needed. */
export const on = (kind, heard) => CHANGED.addEventListener(kind, (event) => heard(event.detail));
const tell = (kind, detail) => CHANGED.dispatchEvent(new CustomEvent(kind, { detail }));

export const say = (sentence, good = true) => tell("said", { sentence, good });

async function asked(path, init = {}) {
  try {
    const answer = await fetch(`api/building${path}`, { ...init, headers: { ...headers(), ...init.headers } });
    if (answer.status === 401) {
      tell("token");
      return { done: false, sentence: "This page needs the token that waychair printed when it started." };
    }
    return await answer.json();
  } catch {
    return { done: false, sentence: "The editor does not answer. Your edits up to now are kept; start it again." };
  }
}

/** Takes an answer over into the model. */
function take(answer) {
  const { done, sentence, submaps, drawn, notes = [], ...rest } = answer;
  for (const name in rest) if (name in model) model[name] = rest[name];
  if (submaps) {
    Object.assign(model.submaps, submaps);
    for (const path in model.submaps) if (!model.paths.includes(path)) delete model.submaps[path];
    Object.assign(model.drawn, drawn);
  }
  const all = [...(sentence ? [sentence] : []), ...notes];
  if (all.length) say(all.join(" "), done);
  tell("change", answer);
}

/** Reads the whole building. */
export async function load() {
  const answer = await asked("");
  if (answer.done) [model.submaps, model.drawn] = [{}, {}];
  take(answer);
  return answer.done;
}

let queue = Promise.resolve();

/** Sends a command; resolves to its answer. Commands wait for those before them. */
export function post(name, values = {}) {
  queue = queue.then(async () => {
    const sent = model.revision;
    const body = JSON.stringify({ ...values, revision: sent });
    const answer = await asked(`/${name}`, { method: "POST", body });
    take(answer);
    if (!answer.done && answer.revision > sent) await load(); // another page was faster
    return answer;
  });
  return queue;
}

/** Does an edit; resolves to whether it was done. */
export const edit = async (op) => (await post("edit", { op })).done;

export async function importFile(file) {
  const query = new URLSearchParams({ name: file.name, revision: model.revision });
  take(await asked(`/import?${query}`, { method: "POST", body: file }));
}

export const mapFolders = async () => (await asked("/maps")).maps ?? [];

/** A picture of a storey's map with its geometry: {url, columns, rows, resolution, pose}; null without a map. */
export async function grid(storey, theme) {
  const found = await fetch(`api/building/grid.png?${new URLSearchParams({ storey, theme })}`, { headers: headers() });
  if (found.status !== 200) return null;
  const [columns, rows, resolution, ...pose] = found.headers.get("x-geometry").split(" ").map(Number);
  return { image: await createImageBitmap(await found.blob()), columns, rows, resolution, pose };
}

export async function download(format) {
  const found = await fetch(`api/building/export?${new URLSearchParams({ format })}`, { headers: headers() });
  if (found.status !== 200) {
    say((await found.json()).sentence, false);
    return;
  }
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await found.blob());
  link.download = /filename="([^"]+)"/.exec(found.headers.get("content-disposition"))[1];
  link.click();
}

async function hearNews() {
  const news = await asked("/news");
  if (news.done && news.revision > model.revision) {
    await queue;
    if (news.revision > model.revision) {
      say("Another page has changed the building.");
      await load();
    }
  } else if (news.done && JSON.stringify(news.foreign) !== JSON.stringify(model.foreign)) {
    model.foreign = news.foreign;
    tell("change", news);
  }
}

setInterval(() => document.visibilityState === "visible" && model.revision && hearNews(), NEWS_MS);

/** Every node of a storey: {ref, path, id, kind, x, y, name}, in the order of the files. */
export function nodesOf(storey) {
  const found = [];
  for (const path of model.paths) {
    const submap = model.submaps[path];
    if (!submap || submap.storey !== storey) continue;
    for (const [id, kind, x, y, name] of submap.nodes) found.push({ ref: `${path}:${id}`, path, id, kind, x, y, name });
  }
  return found;
}

/** A node by its address; null without it. */
export function nodeAt(ref) {
  const at = ref.lastIndexOf(":");
  const [path, id] = [ref.slice(0, at), ref.slice(at + 1)];
  const row = model.submaps[path]?.nodes.find(([other]) => other === id);
  if (!row) return null;
  const [, kind, x, y, name, by] = row;
  return { ref, path, id, kind, x, y, name, by, storey: model.submaps[path].storey };
}

const parentOf = (path) => path.split("/").slice(0, -1).join("/");
export const childOf = (path, last) => (path ? `${path}/${last}` : last);
export { parentOf };

/** The addresses of an arc's two ends. */
export function endsOf(path, [one, other]) {
  const inner = other.lastIndexOf(":");
  const end = inner < 0 ? `${path}:${other}` : `${childOf(path, other.slice(0, inner))}:${other.slice(inner + 1)}`;
  return [`${path}:${one}`, end];
}

/** All arcs and doorways of a storey: {ref, path, door, ends, ...properties}. */
export function arcsOf(storey) {
  const found = [];
  for (const path of model.paths) {
    const submap = model.submaps[path];
    if (!submap || submap.storey !== storey) continue;
    for (const arc of submap.arcs) found.push({ ...arc, path, door: false, ends: endsOf(path, arc.ends) });
    for (const arc of submap.doors) found.push({ ...arc, path, door: true, ends: endsOf(path, arc.ends) });
  }
  return found;
}

/** An arc or doorway by its address, whichever of its ends is named first; null without it. */
export function arcAt(ref) {
  const [path, ends] = [ref.slice(0, ref.indexOf(":")), ref.slice(ref.indexOf(":") + 1)];
  const both = [ref, `${path}:${ends.split(">").reverse().join(">")}`];
  const submap = model.submaps[path];
  const found = submap && [...submap.arcs, ...submap.doors].find((each) => both.includes(each.ref));
  return found ? { ...found, path, door: found.ends[1].includes(":"), ends: endsOf(path, found.ends), storey: submap.storey } : null;
}

export const titleOf = (path) => model.submaps[path]?.name || path.split("/").at(-1) || model.name;
