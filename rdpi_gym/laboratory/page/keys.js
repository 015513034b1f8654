// Shortcuts: one letter each, never while something is typed.

import {addAt} from "./cards.js";
import {openDataImport} from "./data_import.js";
import {byId, h} from "./dom.js";
import {otherTheme} from "./look.js";
import {chooseBy} from "./records.js";
import {redo, undo} from "./staircase.js";
import {setUi, store} from "./state.js";
import {cancel} from "./status.js";
import {panBy, wholeRecord, zoomBy} from "./traces.js";

// A part takes the focus when it is gone to, and not when something in it is pressed.
const jump = (id) => () => {
  const part = byId(id);
  part.setAttribute("tabindex", "-1");
  part.addEventListener("blur", () => part.removeAttribute("tabindex"), {once: true});
  part.scrollIntoView({block: "start"});
  part.focus({preventScroll: true});
};

const KEYS = [
  ["Work", [
    ["u", "Undo (also Ctrl+Z)", undo],
    ["r", "Redo (also Ctrl+Shift+Z)", redo],
    ["x", "Cancel what is running", cancel],
    ["1 … 9", "Add the candidate at that place", null],
    ["o", "Bring data", openDataImport],
  ]],
  ["Look", [
    ["j", "Next record", () => chooseBy(1)],
    ["k", "Record before", () => chooseBy(-1)],
    ["+", "Zoom in", () => zoomBy(0.5)],
    ["-", "Zoom out", () => zoomBy(2)],
    ["[", "Earlier", () => panBy(-0.5)],
    ["]", "Later", () => panBy(0.5)],
    ["0", "Whole record", wholeRecord],
    ["b", "Dragging brushes", () => setUi({mode: "brush"})],
    ["z", "Dragging zooms", () => setUi({mode: "zoom"})],
    ["m", "Dragging leaves out", () => setUi({mode: "mask"})],
    ["Esc", "Clear the brushed stretch", null],
  ]],
  ["Go to", [
    ["d", "Data", jump("part-data")],
    ["f", "Fit and compare", jump("part-compare")],
    ["l", "Learn what is missing", jump("part-learn")],
    ["w", "Residual", jump("part-left")],
    ["p", "Control payoff", jump("part-buys")],
    ["h", "Export", jump("part-home")],
    ["t", "Light or dark", otherTheme],
    ["?", "This list", () => byId("keys").showModal()],
  ]],
];

export function beginKeys() {
  byId("keys-body").append(...KEYS.map(([title, keys]) => h("section", {}, h("h3", {}, title),
    h("dl", {}, keys.map(([key, says]) => [h("dt", {}, h("kbd", {}, key)), h("dd", {}, says)])))));
  byId("help").addEventListener("click", () => byId("keys").showModal());
  byId("keys-close").addEventListener("click", () => byId("keys").close());
  byId("theme").addEventListener("click", otherTheme);
  for (const link of document.querySelectorAll("#parts a")) {
    link.addEventListener("click", (event) => {
      event.preventDefault();
      jump(link.hash.slice(1))();
    });
  }
  const known = new Map(KEYS.flatMap(([, keys]) => keys.filter(([, , run]) => run).map(([key, , run]) => [key, run])));
  document.addEventListener("keydown", (event) => {
    const typing = event.target.closest?.("input:not([type=range]):not([type=radio]), select, textarea");
    if (typing || document.querySelector("dialog[open]")) return;
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z") {
      event.preventDefault();
      (event.shiftKey ? redo : undo)();
      return;
    }
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Escape" && store.ui.brush) setUi({brush: null});
    else if (/^[1-9]$/.test(event.key)) addAt(Number(event.key));
    else if (known.has(event.key)) {
      event.preventDefault();
      known.get(event.key)();
    }
  });
}
