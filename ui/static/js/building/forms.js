// Forms from lists of fields: {key, label, type, value, choices, wide}; buttons {label, run, main, bad}.

/** Creates an element with properties and children. */
export function element(tag, properties = {}, ...children) {
  const { data = {}, ...rest } = properties;
  const made = Object.assign(document.createElement(tag), rest);
  Object.assign(made.dataset, data);
  made.append(...children.filter((each) => each !== null));
  return made;
}

let count = 0;

function control(field) {
  const { type = "text", value, choices } = field;
  if (choices) {
    const select = element("select");
    for (const [key, title] of choices) select.append(element("option", { value: key, textContent: title }));
    select.value = value ?? choices[0]?.[0] ?? "";
    return select;
  }
  if (type === "check") return element("input", { type: "checkbox", checked: Boolean(value) });
  const input = element("input", { type: "text", autocomplete: "off", value: value ?? "" });
  if (type === "number") input.inputMode = "decimal";
  return input;
}

/** The value of a control: a number or null for numbers, else text or a boolean. */
function valueOf(field, input) {
  if (field.type === "check") return input.checked;
  if (field.type !== "number") return input.value;
  const text = input.value.trim().replace(",", ".");
  if (!text) return null;
  const number = Number(text);
  if (!Number.isFinite(number)) throw new Error(`${field.label}: '${text}' is no number.`);
  return number;
}

/**
 * A form. The first button is pressed by Enter in a field. `run` of a button gets the fields' values; `fail` is told a
 * sentence where a field is no number. `key` names the form, so that the focus comes back to it when it is made again.
 */
export function form({ key, title, text = "", fields = [], buttons = [] }, fail) {
  const made = element("form", { noValidate: true, data: { form: key, scanGroup: title } });
  made.append(element("h3", { textContent: title }));
  if (text) made.append(element("p", { className: "quiet", textContent: text }));
  const inputs = {};
  const grid = element("div", { className: "fields" });
  for (const field of fields) {
    count += 1;
    const input = control(field);
    input.id = `field-${count}`;
    Object.assign(input.dataset, { field: field.key, scan: "" });
    inputs[field.key] = input;
    if (field.heard) input.addEventListener("change", () => field.heard(input.value, inputs));
    const shape = field.type === "check" ? "check" : field.wide ? "wide" : "";
    const label = element("label", { className: shape, htmlFor: input.id });
    if (field.type === "check") label.append(input, field.label);
    else label.append(field.label, input);
    grid.append(label);
  }
  if (fields.length) made.append(grid);
  const row = element("div", { className: "row" });
  const act = async (run) => {
    try {
      await run(Object.fromEntries(fields.map((field) => [field.key, valueOf(field, inputs[field.key])])));
    } catch (error) {
      fail(error.message);
    }
  };
  buttons.forEach(({ label, run, main, bad }, index) => {
    const button = element("button", {
      type: index ? "button" : "submit",
      textContent: label,
      className: main ? "main" : bad ? "bad" : "",
      data: { scan: "", button: label },
    });
    if (index) button.addEventListener("click", () => act(run));
    row.append(button);
  });
  if (buttons.length) made.append(row);
  made.addEventListener("submit", (event) => {
    event.preventDefault();
    if (buttons.length) act(buttons[0].run);
  });
  return made;
}

/** The place of the focus within a panel, so that it can be found again after the panel was made anew. */
function focusIn(panel) {
  const active = document.activeElement;
  if (!panel.contains(active)) return null;
  const own = active.closest("[data-form]");
  if (!own) return active.dataset.ref ? { ref: active.dataset.ref } : null;
  return { form: own.dataset.form, field: active.dataset.field, button: active.dataset.button };
}

/**
 * Replaces what is in a panel. The focus goes back to the same field or button; where that is gone, to the panel's first
 * control.
 */
export function fill(panel, ...children) {
  const before = focusIn(panel);
  const typed = panel.contains(document.activeElement) && document.activeElement.matches("input[type=text]")
    ? [document.activeElement.selectionStart, document.activeElement.selectionEnd]
    : null;
  panel.replaceChildren(...children.filter((each) => each !== null));
  if (!before) return;
  const own = before.ref
    ? panel.querySelector(`[data-ref="${CSS.escape(before.ref)}"]`)
    : panel.querySelector(`[data-form="${CSS.escape(before.form)}"]`);
  const wanted = before.field ? `[data-field="${CSS.escape(before.field)}"]` : `[data-button="${CSS.escape(before.button ?? "")}"]`;
  const target = before.ref ? own : own?.querySelector(wanted);
  const found = target ?? panel.querySelector("button, input, select");
  found?.focus({ preventScroll: true });
  if (typed && found?.matches?.("input[type=text]")) found.setSelectionRange(...typed);
}
