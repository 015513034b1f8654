// A chooser for one file: its first rows, which column is what and in which unit, and a button to read it again.

import {Problem, get, post, tell} from "./api.js";
import {h, replace} from "./dom.js";
import {count} from "./format.js";
import {setServer, setUi} from "./state.js";

const ROLES = {t: "Time", u: "Command", y: "Measured"};
const SEPARATORS = ["comma", "semicolon", "tab", "blanks"];

/** Make the chooser of a file behind a heading; what it is refused with is written into `line`. */
export function chooser(file, line, heading, open = false) {
  const box = h("div", {class: "chooser"});
  const details = h("details", {class: "columns", open}, h("summary", {"data-testid": `columns-${file}`}, heading), box);
  details.addEventListener("toggle", () => { if (details.open && !box.childElementCount) preview(file, null, box, line); });
  return details;
}

async function preview(file, separator, box, line) {
  try {
    replace(box, form(file, await get("/api/preview", {file, separator}), box, line));
  } catch (error) {
    if (error instanceof Problem) line.textContent = error.message;
    else tell(error);
  }
}

function form(file, shown, box, line) {
  const {columns, rows, chosen, units, separator, alike} = shown;
  const heads = columns.slice(0, rows[0]?.length ?? 0).map(({name}) => h("th", {scope: "col"}, name, h("small")));
  const choices = {};
  const fields = Object.entries(ROLES).map(([role, name]) => {
    const unit = h("input", {type: "text", class: "short", value: units[role], list: `units-${role}`, spellcheck: "false", autocomplete: "off",
      "data-testid": `unit-${role}-${file}`, "aria-label": `Unit of ${name.toLowerCase()}`});
    const select = h("select", {"data-testid": `column-${role}-${file}`, onchange: () => {
      unit.value = columns[select.value]?.unit || unit.value;
      mark();
    }}, role === "t" ? h("option", {value: ""}, "none: sampling time") : "",
    columns.map(({source, name: text}, k) => h("option", {value: k, selected: source === chosen[role]}, text)));
    if (chosen[role] === "") select.value = "";
    choices[role] = {select, unit};
    const column = columns.length ? h("label", {class: "field"}, name, select) : name;
    return h("span", {class: "field", "data-role": role}, column, h("span", {class: "field"}, "in ", unit));
  });
  const every = h("input", {type: "text", class: "short", inputmode: "decimal", value: shown.ts_s ?? "", "data-testid": `sampling-${file}`});
  const sampling = h("label", {class: "field"}, "Sampling time ", every, " s");
  const parted = separator && h("select", {"data-testid": `separator-${file}`, onchange: () => preview(file, parted.value, box, line)},
    h("option", {value: ""}, separator.chosen ? "found by itself" : `found: ${separator.found}`),
    SEPARATORS.map((name) => h("option", {value: name, selected: name === separator.chosen}, name)));
  const also = h("input", {type: "checkbox", checked: true, "data-testid": `alike-${file}`});
  const button = h("button", {type: "submit", "data-testid": `apply-columns-${file}`}, "Read again");

  const source = (role) => columns[choices[role].select.value]?.source ?? "";
  function mark() {
    heads.forEach((head, k) => {
      const roles = Object.keys(ROLES).filter((role) => choices[role].select.value === String(k));
      head.className = roles.length ? "taken" : "";
      head.lastChild.textContent = roles.map((role) => ROLES[role]).join(", ");
    });
    const timed = source("t") !== "";
    sampling.hidden = timed;
    choices.t.unit.parentElement.hidden = !timed;
  }
  mark();

  async function read(event) {
    event.preventDefault();
    const ts_s = source("t") === "" ? Number(every.value.replace(",", ".")) : null;
    const wrong = ts_s !== null && !(ts_s > 0 && Number.isFinite(ts_s));
    every.setAttribute("aria-invalid", String(wrong));
    if (wrong) {
      line.textContent = `${file}: there is no time column; give the sampling time in s, as in 5e-5`;
      every.focus();
      return;
    }
    const change = {ts_s, units: Object.fromEntries(Object.keys(ROLES).map((role) => [role, choices[role].unit.value.trim() || null]))};
    if (columns.length) change.columns = Object.fromEntries(Object.keys(ROLES).map((role) => [role, source(role)]));
    if (separator) change.separator = parted.value || null;
    const names = [shown.record, ...(also.checked ? alike : [])];
    button.disabled = true;
    try {
      setServer(await post("/api/settings", {records: Object.fromEntries(names.map((name) => [name, change]))}));
      setUi({notice: null});
    } catch (error) {
      if (error instanceof Problem) line.textContent = error.message;
      else tell(error);
    } finally {
      button.disabled = false;
    }
  }
  return h("form", {onsubmit: read},
    rows.length ? h("div", {class: "scroll", tabindex: 0, role: "group", "aria-label": `First rows of ${file}`},
      h("table", {"data-testid": `preview-${file}`}, h("thead", {}, h("tr", {}, heads)),
        h("tbody", {}, rows.map((row) => h("tr", {}, heads.map((_, k) => h("td", {}, row[k] ?? "")))))),
      columns.length > heads.length ? h("p", {class: "note"}, `and ${count(columns.length - heads.length, "more column")}`) : "",
      shown.taken.length ? h("p", {class: "note", "data-testid": `taken-${file}`}, `As read: ${shown.taken.join("; ")}`) : "") : "",
    h("div", {class: "fields"}, fields[0], sampling, fields[1], fields[2],
      parted ? h("label", {class: "field"}, "Separator ", parted) : ""),
    h("p", {class: "row"}, button,
      alike.length ? h("label", {class: "field"}, also, `and ${count(alike.length, "other file")} with the same columns`) : ""));
}
