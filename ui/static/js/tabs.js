// Tabs by pointer and by arrow keys (WAI-ARIA Authoring Practices, Tabs).

import { $ } from "./page.js";

const tabs = [...document.querySelectorAll("[role=tab]")];
const SHOWN = new EventTarget();

/** Registers a listener for the id of the panel that is shown. */
export const onTab = (heard) => SHOWN.addEventListener("tab", ({ detail }) => heard(detail));

export function showTab(name, focus = "") {
  for (const tab of tabs) {
    const shown = tab.getAttribute("aria-controls") === name;
    tab.setAttribute("aria-selected", String(shown));
    tab.tabIndex = shown ? 0 : -1;
    $(tab.getAttribute("aria-controls")).hidden = !shown;
  }
  SHOWN.dispatchEvent(new CustomEvent("tab", { detail: name }));
  if (focus) $(focus).focus();
  $(name).parentElement.scrollIntoView({ block: "nearest" });
}

for (const [index, tab] of tabs.entries()) {
  tab.addEventListener("click", () => showTab(tab.getAttribute("aria-controls")));
  tab.addEventListener("keydown", ({ key }) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[key];
    if (!step) return;
    const next = tabs[(index + step + tabs.length) % tabs.length];
    showTab(next.getAttribute("aria-controls"), next.id);
  });
}
