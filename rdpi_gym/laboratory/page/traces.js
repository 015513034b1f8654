// The record over time: measured and modelled displacement, and below them what they differ by.

import {act, get, latest} from "./api.js";
import {byId, h, replace} from "./dom.js";
import {number, typed, withUnit} from "./format.js";
import {OVER, colour, draw, faint, line, noiseBand, nothing} from "./look.js";
import {draggable} from "./span.js";
import {presentStep, recordNamed, setUi, store, symbols, units, watch} from "./state.js";

const POINTS = 3000;
const LEAST_SAMPLES = 8;
const FEW = 250; // samples that are drawn as points, too

let shown = null; // the trace that is drawn
const followers = [];
let preview = null; // {effect, t_s, other_um}
let marks = null; // what the server says of the brushed stretch: [[t0, t1], ...]

const MODES = [
  ["brush", "Brush", "Dragging marks a stretch in every view"],
  ["zoom", "Zoom", "Dragging shows a stretch alone, every sample of it"],
  ["mask", "Leave out", "Dragging leaves a stretch out of every error"],
  ["skip", "Skip start", "Dragging leaves out the start, up to where you let go"],
];

export function beginTraces() {
  for (const box of [byId("trace"), byId("residual")]) {
    draggable(box, {done: spanned, cleared: wholeRecord, zoomed: zoomAt});
  }
  beginTools();
  const fetchTrace = latest(
    (record, range, step) => get("/api/trace", {record, from_s: range?.[0], to_s: range?.[1], step, points: POINTS}),
    (trace) => showTrace(trace),
  );
  const fetchPreview = latest(
    (record, range, step, effect) =>
      get("/api/trace", {record, from_s: range?.[0], to_s: range?.[1], step, effect, points: POINTS}),
    (trace, record, range, step, effect) => {
      if (store.ui.preview !== effect) return;
      preview = trace.other_um ? {effect, t_s: trace.t_s, other_um: trace.other_um} : null;
      drawResidual();
    },
  );
  watch(
    (server, ui) => [ui.record, ui.range, server.current, recordNamed(server, ui.record), presentStep(server)?.errors],
    ([record, range, step]) => {
      if (record) fetchTrace(record, range, step);
    },
  );
  watch(
    (server, ui) => [ui.preview, ui.record, ui.range, server.current, presentStep(server)?.errors],
    ([effect, record, range, step]) => {
      if (effect && record) fetchPreview(record, range, step, effect);
      else {
        fetchPreview.forget();
        if (preview) {
          preview = null;
          drawResidual();
        }
      }
    },
  );
  watch((server, ui) => [ui.theme, server.noise_um, server.quantities], () => drawBoth());
}

/** Draw a trace: of the server's answer, or of a parameter that is being dragged. */
export function showTrace(trace) {
  shown = trace;
  drawBoth();
  for (const follow of followers) follow(trace);
}

/** Call `follow` with every trace that is drawn: of the step, or of a parameter that is being dragged. */
export const onTrace = (follow) => followers.push(follow);

/** Highlight stretches of time; null: none. */
export function markSpans(spans) {
  marks = spans;
  drawBoth();
}

export const shownSpan = () => (shown?.t_s?.length ? [shown.t_s[0], shown.t_s.at(-1)] : null);

function drawBoth() {
  if (!shown) return;
  drawTrace();
  drawResidual();
}

function spanShapes() {
  const shape = (x0, x1, fillcolor, name) => ({
    type: "rect", yref: "paper", y0: 0, y1: 1, x0, x1, fillcolor, line: {width: 0}, layer: "below", name,
  });
  const [first, last] = shownSpan();
  const seen = ([from, to]) => to >= first && from <= last;
  const cut = ([from, to]) => [Math.max(from, first), Math.min(to, last)];
  return [
    ...(shown.counted ?? []).filter(seen).map(cut).map(([a, b]) => shape(a, b, faint("reference", 0.25), "left-out")),
    ...(marks ?? []).filter(seen).map(cut).map(([a, b]) => shape(a, b, faint("brush", 0.28), "brushed")),
  ];
}

const pointed = () => (shown.t_s.length <= FEW ? {mode: "lines+markers", marker: {size: 3.5}} : {});
const timeAxis = () => ({range: shownSpan(), autorange: false, hoverformat: ".6~g", unifiedhovertitle: {text: "%{x} s"}});

function drawTrace() {
  const data = [line("measured", shown.t_s, shown.y_um, {colour: colour("measured"), width: 2, ...pointed()})];
  if (shown.model_um) data.push(line("model", shown.t_s, shown.model_um, {colour: colour("model"), ...OVER}));
  draw(byId("trace"), data, {x: {...timeAxis(), showticklabels: false}, shapes: spanShapes(), hover: "x unified", margin: {b: 6}});
}

function drawResidual() {
  const box = byId("residual");
  nothing(box, shown.residual_um ? null : "waits for the model");
  if (!shown.residual_um) return;
  const shapes = spanShapes();
  const noise = store.server.noise_um;
  if (noise) shapes.push(noiseBand(-noise, noise));
  const data = [line("now", shown.t_s, shown.residual_um, {colour: preview ? faint("residual", 0.45) : colour("residual"), width: 1, ...pointed()})];
  if (preview) {
    data.push(line(`with ${title(preview.effect)}`, preview.t_s, preview.other_um, {colour: colour("rising"), width: 1}));
  }
  draw(box, data, {x: timeAxis(), shapes, hover: "x unified"});
  byId("residual-words").replaceChildren(...legend(preview ? [["now", "residual"], [`with ${title(preview.effect)}`, "rising"]] : []));
}

export const legend = (entries) =>
  entries.map(([text, of]) => h("span", {class: "legend", style: {"--of": `var(--${of})`}}, text));

const title = (effect) => store.server.ranking?.cards.find((card) => card.effect === effect)?.title.toLowerCase() ?? effect;

function spanned(from, to) {
  const {mode, record} = store.ui;
  if (mode === "zoom") zoomTo(from, to);
  else if (mode === "brush") setUi({brush: {by: "time", from, to}});
  else leaveOut(record, mode, from, to);
}

async function leaveOut(record, mode, from, to) {
  const now = recordNamed(store.server, record);
  // what is skipped already is no longer shown, and counts
  const change = mode === "skip" ? {skip_s: (now.skip_s ?? 0) + to - startOf()} : {masked_s: [...now.masked_s, [from, to]]};
  await act("/api/settings", {records: {[record]: change}});
  setUi({mode: "brush"});
}

// a skipped start is counted from the first sample, wherever its clock begins
const startOf = () => (store.ui.range === null ? shownSpan()[0] : Number(byId("trace").dataset.start ?? 0));

function extent() {
  const record = recordNamed(store.server, store.ui.record);
  const start = Number(byId("trace").dataset.start ?? 0);
  return record ? [start, start + record.duration_s] : null;
}

export function zoomTo(from, to) {
  const record = recordNamed(store.server, store.ui.record);
  if (!record || !shownSpan()) return;
  if (store.ui.range === null) byId("trace").dataset.start = shownSpan()[0];
  const [first, last] = extent();
  const least = LEAST_SAMPLES * record.ts_s;
  const middle = 0.5 * (from + to);
  const half = Math.max(0.5 * (to - from), 0.5 * least);
  const low = Math.max(first, middle - half);
  const high = Math.min(last, middle + half);
  const all = low <= first + 0.5 * record.ts_s && high >= last - 0.5 * record.ts_s;
  setUi({range: all ? null : [low, high]});
}

function zoomAt(at, factor) {
  const [from, to] = shownSpan();
  zoomTo(at - factor * (at - from), at + factor * (to - at));
}

/** Zoom about the middle of what is shown; 2 shows twice as much. */
export function zoomBy(factor) {
  const span = shownSpan();
  if (span) zoomAt(0.5 * (span[0] + span[1]), factor);
}

/** Go on by a share of what is shown: to the right where it is positive. */
export function panBy(share) {
  const span = shownSpan();
  if (!span || store.ui.range === null) return;
  const [first, last] = extent();
  const wide = span[1] - span[0];
  const from = Math.min(Math.max(span[0] + share * wide, first), last - wide);
  setUi({range: [from, from + wide]});
}

export function wholeRecord() {
  if (store.ui.range !== null) setUi({range: null});
  else setUi({brush: null});
}

function beginTools() {
  const modes = MODES.map(([mode, text, says]) =>
    h("button", {type: "button", "data-testid": `mode-${mode}`, title: says, onclick: () => setUi({mode})}, text));
  byId("modes").append(...modes);
  watch((server, ui) => ui.mode, (mode) => {
    modes.forEach((button, i) => button.setAttribute("aria-pressed", String(MODES[i][0] === mode)));
    byId("plots").dataset.mode = mode;
  });
  const field = (name, label) =>
    h("input", {type: "text", inputmode: "decimal", class: "short", "data-testid": name, "aria-label": label});
  const from = field("brush-from", "Brushed stretch, from (s)");
  const to = field("brush-to", "Brushed stretch, to (s)");
  const take = () => {
    const [a, b] = [Number(from.value), Number(to.value)];
    if (from.value && to.value && b > a) setUi({brush: {by: "time", from: a, to: b}});
  };
  from.addEventListener("change", take);
  to.addEventListener("change", take);
  const clear = h("button", {type: "button", class: "quiet", "data-testid": "clear-brush", onclick: () => setUi({brush: null})}, "Clear");
  byId("stretch").append("Stretch ", from, " to ", to, " s ", clear);
  watch((server, ui) => ui.brush, (brush) => {
    const timed = brush?.by === "time";
    from.value = timed ? typed(brush.from, 5) : "";
    to.value = timed ? typed(brush.to, 5) : "";
    clear.disabled = !brush;
  });
  const whole = byId("whole");
  whole.addEventListener("click", wholeRecord);
  watch((server, ui) => ui.range, (range) => { whole.disabled = !range; });
  watch(
    (server, ui) => [server.quantities, ui.record, presentStep(server)?.errors, server.noise_um],
    ([, record, errors, noise]) => {
      const {u, y} = units();
      byId("trace-title").textContent = `${capital(store.server.quantities?.output?.name ?? "displacement")} over time, ${y} over s`;
      byId("residual-title").textContent = `Measured − model, ${y}`;
      replace(byId("trace-words"), legend([["measured", "measured"], ...(errors ? [["model", "model"]] : [])]));
      const error = errors?.by_record_um?.[record];
      replace(byId("record-words"), h("strong", {}, record ?? ""), error === undefined ? "" : ` ${withUnit(error, y)} rms`,
        noise ? h("span", {class: "legend band"}, `noise ${withUnit(noise, y)}`) : "");
      byId("trace").setAttribute("aria-label", `Measured and modelled ${symbols().y} of ${record} over time`);
      byId("residual").setAttribute("aria-label",
        `Measured minus model of ${record} over time${error === undefined ? "" : `, rms ${number(error)} ${y}`}; command in ${u}`);
    },
  );
}

const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);
