// Shows the latest view of all chairs; asks for it four times a second.
"use strict";
const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00"];
const NS = "http://www.w3.org/2000/svg";
const map = document.getElementById("map");

function element(name, attributes, text) {
  const made = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

function drawPlan(plan) {
  const [x0, y0] = plan.corner, [width, height] = plan.size;
  map.setAttribute("viewBox", `${x0} ${-y0 - height} ${width} ${height}`);
  const flipped = element("g", { transform: "scale(1 -1)" });
  for (const [x, y, length, thickness] of plan.walls)
    flipped.append(element("rect", { x, y, width: length, height: thickness, fill: "#333" }));
  for (const [name, x, y] of plan.places)
    flipped.append(element("text", {
      x, y: -y, transform: "scale(1 -1)", "font-size": 0.45, "text-anchor": "middle", fill: "#777" }, name));
  const moving = element("g", { id: "moving" });
  flipped.append(moving);
  map.append(flipped);
}

function drawView(view) {
  const moving = document.getElementById("moving");
  moving.replaceChildren();
  for (const [x, y] of view.people) moving.append(element("circle", { cx: x, cy: y, r: 0.25, fill: "#a0a" }));
  const list = document.getElementById("chairs");
  list.replaceChildren();
  view.chairs.forEach((chair, k) => {
    const colour = COLOURS[k % COLOURS.length];
    moving.append(element("polygon", { points: chair.corners.map((p) => p.join(",")).join(" "), fill: colour }));
    if (chair.line)
      moving.append(element("line", { x1: chair.line[0][0], y1: chair.line[0][1], x2: chair.line[1][0],
        y2: chair.line[1][1], stroke: colour, "stroke-width": 0.08, "stroke-dasharray": "0.2 0.1" }));
    const item = document.createElement("li");
    item.style.borderColor = colour;
    const goal = chair.goal ? `drives to ${chair.goal}` : "has done its goals";
    item.textContent = `Chair ${k}: ${goal} (${chair.reached} of ${chair.goals}). ${chair.told}`;
    list.append(item);
  });
  document.getElementById("time").textContent = `${view.seconds} s of the chairs' time`;
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
    document.getElementById("time").textContent = "The demo has ended.";
    return;
  }
  setTimeout(show, 250);
}
show();
