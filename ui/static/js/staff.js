// The staff's page: shows the latest view once a second, and sends priorities with the token and the staff's key.
"use strict";
const byId = (id) => document.getElementById(id);
let token = "";

function say(id, sentence) {
  if (byId(id).textContent !== sentence) byId(id).textContent = sentence;
}

async function ask(path, body) {
  const headers = { Authorization: `Bearer ${token}` };
  const answer = await fetch(path, body === undefined ? { headers } : { headers, method: "POST", body });
  if (!answer.ok) throw new Error(await answer.text());
  return answer;
}

function rows(id, values) {
  byId(id).replaceChildren(...values.map((cells) => {
    const row = document.createElement("tr");
    for (const cell of cells) row.insertCell().textContent = cell;
    return row;
  }));
}

function items(id, values, none) {
  byId(id).replaceChildren(...(values.length ? values : [none]).map((value) => {
    const item = document.createElement("li");
    item.textContent = value;
    return item;
  }));
}

function offer(chairs) {
  const known = [...byId("chair").options].map((option) => option.value).join();
  if (known === chairs.join()) return; // a choice under way stays
  byId("chair").replaceChildren(...chairs.map((chair) => new Option(`Chair ${chair}`, chair)));
}

function show(view) {
  offer(view.chairs.map((each) => each.chair));
  rows("chairs", view.chairs.map((each) => [each.chair, each.at, each.goal,
    each.minutes_left === null ? each.priority : `${each.priority}, ${each.minutes_left} min more`, each.told]));
  items("queues", view.queues.map((each) => `${each.place}: chair ${each.chairs.join(", then ")}`), "Nobody waits for a way.");
  items("closed", view.closed, "None.");
  rows("waited", view.waited.map((each) => [`${each.minutes_ago} min ago`, `chair ${each.waits}`,
    each.first === null ? "nobody" : `chair ${each.first}`, each.place, each.rule, Math.round(each.real_s),
    each.foreseen_s === null ? "" : Math.round(each.foreseen_s)]));
}

async function look() {
  try {
    const view = await (await ask("view")).json();
    if (view.chairs) show(view);
    byId("entry").hidden = true;
    byId("shown").hidden = false;
    say("news", view.chairs ? `${view.chairs.length} chairs are known.` : "No chair has been heard yet.");
  } catch (error) {
    const lost = error instanceof TypeError;
    say("news", lost ? "The connection is lost: what is shown may be old." : error.message);
    if (!lost) {
      byId("entry").hidden = false;
      byId("shown").hidden = true;
      return;
    }
  }
  setTimeout(look, 1000);
}

byId("entry").addEventListener("submit", (event) => {
  event.preventDefault();
  token = byId("token").value;
  look();
});

byId("give").addEventListener("submit", async (event) => {
  event.preventDefault();
  const values = {
    chair: Number(byId("chair").value),
    priority: document.querySelector("input[name=priority]:checked").value,
    key: byId("key").value,
    minutes: Number(byId("minutes").value),
  };
  byId("key").value = "";
  try {
    say("given", await (await ask("priority", JSON.stringify(values))).text());
  } catch (error) {
    say("given", error instanceof TypeError ? "The connection is lost: nothing was given." : error.message);
  }
});
