// The records: what each is used for, how well the model follows it, and what of it is left out.

import {act, remove} from "./api.js";
import {byId, h, icon, replace} from "./dom.js";
import {number, time, typed, whole, withUnit} from "./format.js";
import {sketch} from "./signature.js";
import {presentStep, recordNamed, setUi, store, units, watch} from "./state.js";

const ROLES = {train: "fit", validation: "hold out", test: "test"};

export function beginRecords() {
  watch(
    (server, ui) => [server.records, ui.record, presentStep(server)?.errors.by_record_um, server.quantities],
    drawRecords,
  );
  watch((server) => server.files, drawFiles);
  watch((server, ui) => [recordNamed(server, ui.record), server.settings, server.quantities], drawDetail);
}

export function choose(name) {
  if (name !== store.ui.record) setUi({record: name, blind: false, range: null, brush: null});
}

/** Choose the next record (or, with -1, the one before). */
export function chooseBy(step) {
  const names = store.server.records.map((record) => record.name);
  if (!names.length) return;
  choose(names[(names.indexOf(store.ui.record) + step + names.length) % names.length]);
  document.querySelector("#records [aria-current]")?.scrollIntoView({block: "nearest"});
}

function drawRecords() {
  const errors = presentStep(store.server)?.errors.by_record_um ?? {};
  const {y} = units();
  const largest = Math.max(...Object.values(errors), 0);
  byId("records-count").textContent = store.server.records.length || "";
  replace(byId("records"), store.server.records.map((record) => {
    const {name, role, rows, ts_s, thumbnail} = record;
    const error = errors[name];
    return h("li", {class: `record ${role}`},
      h("button", {
        type: "button", class: "pick", "data-testid": `record-${name}`, "aria-current": name === store.ui.record ? "true" : null,
        onclick: () => choose(name),
      },
      sketch(thumbnail?.u?.length ? [{x: thumbnail.u, y: thumbnail.y, kind: "loop"}] : [], {wide: 46, high: 34}),
      h("span", {class: "name"}, name),
      h("span", {class: "facts"}, `${whole(rows)} × ${time(ts_s)}`)),
      role in ROLES ? h("label", {class: "role"}, h("span", {class: "hidden"}, `Use of ${name}`),
        h("select", {"data-testid": `role-${name}`, onchange: (event) => set(name, {role: event.target.value})},
          Object.entries(ROLES).map(([key, text]) => h("option", {value: key, selected: key === role}, text))))
        : h("span", {class: "role facts", title: "Nothing moves in it: the noise floor comes from it"}, "at rest"),
      h("span", {class: "error"}, error === undefined ? "" : h("b", {}, number(error)), error === undefined ? "" : ` ${y}`),
      h("span", {class: "meter", "aria-hidden": "true"}, h("span", {style: {width: error && largest ? `${(100 * error) / largest}%` : "0"}})));
  }));
}

const rate = (ts_s) => (ts_s < 1e-3 ? withUnit(1e-3 / ts_s, "kHz") : withUnit(1 / ts_s, "Hz"));
const set = (name, change) => act("/api/settings", {records: {[name]: change}});

function drawFiles() {
  const refused = store.server.files.filter((file) => file.problem);
  replace(byId("refused"), refused.map(({name, problem, row, column}) => h("li", {"data-testid": `refused-${name}`},
    h("strong", {}, name),
    row || column ? h("span", {class: "where"}, [row ? `row ${row}` : "", column ? `column ${column}` : ""].filter(Boolean).join(", ")) : "",
    h("p", {}, problem),
    h("button", {type: "button", class: "quiet", "data-testid": `discard-${name}`, "aria-label": `Discard ${name}`,
      onclick: () => act(`/api/files/${encodeURIComponent(name)}`, null, remove)}, "Discard"))));
  byId("refused").hidden = !refused.length;
}

function drawDetail() {
  const record = recordNamed(store.server, store.ui.record);
  byId("detail").hidden = !record;
  if (!record) return;
  const {y, u} = units();
  const skip = h("input", {type: "text", inputmode: "decimal", class: "short", value: typed(record.skip_s ?? 0), "data-testid": "skip",
    "aria-label": "Skipped at the start (s)"});
  skip.addEventListener("change", () => {
    const wanted = Number(skip.value);
    if (Number.isFinite(wanted) && wanted >= 0) set(record.name, {skip_s: wanted});
    else skip.value = typed(record.skip_s ?? 0);
  });
  const masked = record.masked_s ?? [];
  replace(byId("detail-body"),
    h("dl", {class: "facts"},
      h("dt", {}, "Lasts"), h("dd", {}, `${time(record.duration_s, 4)} at ${rate(record.ts_s)}`),
      h("dt", {}, "Command"), h("dd", {}, `${number(record.u[0])} to ${number(record.u[1])} ${u}`),
      h("dt", {}, "Measured"), h("dd", {}, `${number(record.y[0])} to ${number(record.y[1])} ${y}`),
      h("dt", {}, "File"), h("dd", {}, record.file)),
    (record.remarks ?? []).map((text) => h("p", {class: "remark"}, text)),
    h("label", {class: "field"}, "Skip the first ", skip, " s"),
    masked.length ? h("ul", {class: "masked", "aria-label": "Left out"}, masked.map(([from, to], i) => h("li", {},
      `left out: ${number(from, 4)} to ${number(to, 4)} s`,
      h("button", {type: "button", class: "quiet", "aria-label": `Count ${number(from, 4)} to ${number(to, 4)} s again`, "data-testid": `unmask-${i}`,
        onclick: () => set(record.name, {masked_s: masked.filter((_, k) => k !== i)})}, icon("close")))))
      : h("p", {class: "empty"}, "To leave a stretch out, press “Leave out” above the trace and drag over it."),
    columnsBox(record));
}

/** Which column is what, and in which unit. */
function columnsBox(record) {
  const columns = store.server.settings?.columns?.[record.file];
  const known = store.server.settings?.units ?? {};
  const {quantities} = store.server;
  if (!columns?.available?.length && !quantities) return "";
  const choice = (key, label) => h("label", {class: "field"}, label,
    h("select", {"data-testid": `column-${key}`}, columns?.[key] === null ? h("option", {value: ""}, "as found") : "",
      (columns?.available ?? []).map((name) => h("option", {value: name, selected: name === columns[key]}, name))));
  const text = (testid, label, value) => h("label", {class: "field"}, label,
    h("input", {type: "text", class: "short", value: value ?? "", "data-testid": testid, spellcheck: "false"}));
  const named = [["time", "Time"], ["input", "Command"], ["output", "Measured"]];
  const form = h("form", {class: "columns"},
    columns?.available?.length ? named.map(([key, label]) => choice(key, `${label} is column `)) : "",
    text("unit-time", "Time in ", known.time ?? "s"),
    text("unit-input", "Command in ", known.input ?? quantities?.input?.unit),
    text("unit-output", "Measured in ", known.output ?? quantities?.output?.unit),
    h("button", {type: "submit", "data-testid": "apply-columns"}, "Read again"));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const value = (testid) => form.querySelector(`[data-testid="${testid}"]`)?.value.trim();
    const change = {units: Object.fromEntries(named.map(([key]) => [key, value(`unit-${key}`)]).filter(([, given]) => given))};
    if (columns?.available?.length) change.columns = {[record.file]: Object.fromEntries(named.map(([key]) => [key, value(`column-${key}`)]).filter(([, given]) => given))};
    act("/api/settings", change);
  });
  return h("details", {class: "columns"}, h("summary", {"data-testid": "columns"}, `Columns and units of ${record.file}`), form);
}

