// The records: what each is used for, how well the model follows it, and what of it is left out.

import {act, remove} from "./api.js";
import {chooser} from "./chooser.js";
import {byId, h, icon, replace} from "./dom.js";
import {count, number, time, typed, whole, withUnit} from "./format.js";
import {sketch} from "./signature.js";
import {presentStep, recordNamed, setUi, store, units, watch} from "./state.js";

const ROLES = {train: "fit", validation: "hold out", test: "test"};

export function beginRecords() {
  watch(
    (server, ui) => [server.records, ui.record, presentStep(server)?.errors.by_record_um, server.quantities],
    drawRecords,
  );
  watch((server) => [server.files, Boolean(server.problem), server.records.length > 0], drawFiles);
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

const choosers = new Map(); // of refused files, as the reader has set them
const UNFOLDED = 2; // refused files that stand open; the others are behind a line
let othersOpen = false;

/** Files that were refused; where nothing can be read together, all of them. */
function drawFiles([files, mixed, data]) {
  const refused = files.filter((file) => file.problem || (mixed && !data));
  const names = refused.map(({name}) => name);
  for (const name of choosers.keys()) if (!names.includes(name)) choosers.delete(name);
  const rows = refused.map(({name, bytes, problem, row, column}) => {
    if (!choosers.has(name)) {
      const line = h("p", {role: "status"});
      choosers.set(name, {line, box: bytes ? chooser(name, line, "Columns, units and separator", !data && !choosers.size) : ""});
    }
    const {line, box} = choosers.get(name);
    line.textContent = problem ?? "";
    return h("li", {"data-testid": `refused-${name}`},
      h("strong", {}, name),
      row || column ? h("span", {class: "where"}, [row ? `row ${row}` : "", column ? `column ${column}` : ""].filter(Boolean).join(", ")) : "",
      h("button", {type: "button", class: "quiet", "data-testid": `discard-${name}`, "aria-label": `Discard ${name}`,
        onclick: () => discard(name)}, "Discard"),
      line, box);
  });
  const others = rows.splice(rows.length > UNFOLDED + 1 ? UNFOLDED : rows.length);
  replace(byId("refused"), rows, others.length
    ? h("li", {class: "others"}, h("details", {open: othersOpen, ontoggle: (event) => { othersOpen = event.currentTarget.open; }},
      h("summary", {"data-testid": "refused-others"}, `${count(others.length, "more file")} could not be read`), h("ul", {class: "refused"}, others))) : "");
  byId("refused").hidden = !refused.length;
}

async function discard(name) {
  const done = await act(`/api/files/${encodeURIComponent(name)}`, null, remove);
  // it may have been in the way of the others
  if (done && !store.server.records.length && store.server.files.length) act("/api/open");
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
    rereading(record.file));
}

/** Read a file in another way than it was. */
function rereading(file) {
  const line = h("p", {class: "refusal", role: "status"});
  return [chooser(file, line, `Columns and units of ${file}`), line];
}
