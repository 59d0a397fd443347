// Shows the latest view of all chairs; asks for it four times a second.
"use strict";
const COLOURS = ["#0067a3", "#b34e00", "#007a59", "#a8457f", "#8a6100", "#5a4fb0"];
const NS = "http://www.w3.org/2000/svg";
const MARGIN = 0.5;  // m around the floor
const map = document.getElementById("map");

function element(name, attributes, text) {
  const made = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

function strips(rectangles, kind) {
  return rectangles.map(([x, y, width, height]) => element("rect", { x, y, width, height, class: kind }));
}

function writing(kind, x, y, text) {
  return element("text", { x, y: -y, transform: "scale(1 -1)", class: kind }, text);
}

function drawPlan(plan) {
  const all = plan.walls.length ? plan.walls : [[...plan.corner, ...plan.size]];
  const left = Math.min(...all.map((r) => r[0])) - MARGIN, right = Math.max(...all.map((r) => r[0] + r[2])) + MARGIN;
  const low = Math.min(...all.map((r) => r[1])) - MARGIN, high = Math.max(...all.map((r) => r[1] + r[3])) + MARGIN;
  map.setAttribute("viewBox", `${left} ${-high} ${right - left} ${high - low}`);
  const flipped = element("g", { transform: "scale(1 -1)" });
  flipped.append(...strips(plan.floor, "floor"), ...strips(plan.walls, "wall"));
  flipped.append(...plan.places.map(([name, x, y]) => writing("place", x, y - 0.15, name)));
  flipped.append(element("g", { id: "moving" }));
  map.append(flipped);
}

function drawChair(chair, k) {
  const colour = COLOURS[k % COLOURS.length];
  const points = chair.corners.map((p) => p.join(",")).join(" ");
  const [x, y] = [0, 1].map((axis) => chair.corners.reduce((sum, p) => sum + p[axis], 0) / chair.corners.length);
  const ahead = [Math.cos(chair.heading), Math.sin(chair.heading)];
  const tip = [[0.44, 0], [0.24, 0.2], [0.24, -0.2]].map(([along, aside]) =>
    [x + along * ahead[0] - aside * ahead[1], y + along * ahead[1] + aside * ahead[0]].join(",")).join(" ");
  const parts = [
    element("polygon", { points, fill: colour }), element("polygon", { points: tip, fill: "#fff" }),
    writing("number", x - 0.1 * ahead[0], y - 0.1 * ahead[1], chair.number)];
  if (chair.line) {
    const [[x1, y1], [x2, y2]] = chair.line;
    parts.push(element("line", { x1, y1, x2, y2, class: "line", style: `--own: ${colour}` }));
  }
  return parts;
}

function sentence(text) {
  return text ? text[0].toUpperCase() + text.slice(1) + (/[.!?]$/.test(text) ? "" : ".") : "";
}

function drawView(view) {
  const moving = document.getElementById("moving");
  moving.replaceChildren(
    ...view.people.map(([cx, cy]) => element("circle", { cx, cy, r: 0.25, class: "person" })),
    ...view.chairs.flatMap(drawChair));
  const list = document.getElementById("chairs");
  view.chairs.forEach((chair, k) => {
    if (!list.children[k]) {
      const item = document.createElement("li");
      item.style.borderColor = COLOURS[k % COLOURS.length];
      item.append(document.createElement("strong"), document.createElement("span"));
      list.append(item);
    }
    const goal = chair.goal ? `to ${chair.goal}, ${chair.reached} of ${chair.goals} goals reached` : "all goals reached";
    const said = [`Chair ${chair.number}: ${goal}`, sentence(chair.told)];
    said.forEach((text, n) => { if (list.children[k].children[n].textContent !== text) list.children[k].children[n].textContent = text; });
  });
  document.getElementById("time").textContent = `After ${Math.round(view.seconds)} s of the chairs' time`;
}

async function ask(path) {
  const answer = await fetch(path);
  return answer.json();
}

async function show() {
  try {
    if (!document.getElementById("moving")) {
      const plan = await ask("plan");
      if (plan.size) drawPlan(plan);
    } else {
      const view = await ask("view");
      if (view.chairs) drawView(view);
    }
  } catch {
    document.getElementById("time").textContent = "The demo has ended; its report is in its folder.";
    return;
  }
  setTimeout(show, 250);
}
show();
