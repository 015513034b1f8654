// The loop, and what is left over command, rate, frequency and time at rest: small, all at once, linked.

import {get, latest} from "./api.js";
import {byId} from "./dom.js";
import {withUnit} from "./format.js";
import {OVER, colour, draw, faint, line, logAxis, noiseBand, nothing} from "./look.js";
import {draggable} from "./span.js";
import {presentStep, recordNamed, setUi, store, units, watch} from "./state.js";
import {markSpans, onTrace} from "./traces.js";

const VIEWS = {
  command: {x: "u", y: "rms_um", title: ({u}) => `over command, ${u}`},
  rate: {x: "rate", y: "rms_um", title: ({u}) => `over rate, ${u}/s`},
  frequency: {x: "hz", y: "um", log: true, logY: true, title: () => "over frequency, Hz"},
  rest: {x: "s", y: "um", log: true, title: () => "over time at rest, s"},
};

const SILENT = {hoverinfo: "skip", hovertemplate: null}; // one number under the pointer is enough in a small plot

let views = null;
let brushed = null;

export function beginViews() {
  const fetchViews = latest((step, record) => get("/api/views", {step, record}), (answer) => {
    views = answer;
    drawAll();
  });
  const fetchBrush = latest(
    (record, brush, step) => get("/api/brush", {record, by: brush.by, from_s: brush.from, to_s: brush.to, step}),
    (answer, record, brush) => {
      if (store.ui.brush !== brush) return;
      brushed = answer;
      tellStretch();
      markSpans(brush.by === "time" ? [[brush.from, brush.to]] : answer.spans_s ?? []);
      drawAll();
    },
  );
  watch((server, ui) => [server.current, ui.record, recordNamed(server, ui.record), presentStep(server)?.errors],
    ([step, record]) => {
      if (step && record) {
        fetchViews(step, record);
        return;
      }
      fetchViews.forget();
      views = null;
      for (const name of Object.keys(VIEWS)) nothing(byId(name), record ? "waits for the model" : null);
    });
  watch((server, ui) => [ui.brush, ui.record, server.current, presentStep(server)?.errors], () => {
    const {brush, record} = store.ui;
    if (brush && record) {
      if (brush.by === "time") markSpans([[brush.from, brush.to]]);
      fetchBrush(record, brush, store.server.current);
      return;
    }
    fetchBrush.forget();
    brushed = null;
    tellStretch();
    markSpans(null);
    drawAll();
  });
  watch((server, ui) => [ui.theme, server.quantities, server.noise_um], () => {
    for (const [name, view] of Object.entries(VIEWS)) byId(`${name}-title`).textContent = `Residual ${view.title(units())}`;
    byId("loop-title").textContent = `Loop, ${units().y} over ${units().u}`;
    drawAll();
  });
  // the loop is there with the record, before any model is, and follows a parameter that is dragged
  onTrace((trace) => {
    if (trace.record === store.ui.record && store.ui.range === null) drawLoop(trace);
  });
  for (const name of ["loop", "command", "rate", "rest"]) { // a band of frequencies is no stretch of time
    draggable(byId(name), {
      done: (from, to) => setUi({brush: {by: name === "loop" ? "command" : name, from, to}}),
      cleared: () => setUi({brush: null}),
    });
  }
}

function tellStretch() {
  const rms = brushed?.rms_um;
  byId("stretch-words").textContent = rms === null || rms === undefined ? "" : `in the stretch ${withUnit(rms, units().y)} rms`;
}

function drawAll() {
  if (!views) return;
  drawLoop(views.loop);
  for (const name of Object.keys(VIEWS)) drawView(name);
}

function drawLoop(loop) {
  const {u, y} = units();
  const hover = (name) => ({hovertemplate: `%{x:.4~g} ${u}, %{y:.4~g} ${y}<extra>${name}</extra>`});
  const data = [line("measured", loop.u, loop.y_um, {colour: colour("measured"), width: 2, ...hover("measured")})];
  if (loop.model_um) data.push(line("model", loop.u, loop.model_um, {colour: colour("model"), ...OVER, ...hover("model")}));
  if (brushed?.loop?.u?.length) {
    data.push(line("stretch", brushed.loop.u, brushed.loop.y_um, {colour: colour("brush"), width: 2.4, ...hover("stretch")}));
  }
  draw(byId("loop"), data, {hover: "closest", shapes: spanOf("command")});
  byId("loop").setAttribute("aria-label", `Loop of ${store.ui.record}: measured and model over command`);
}

/** The stretch of a view that was dragged over in it. */
function spanOf(name) {
  const {brush} = store.ui;
  if (brush?.by !== name) return [];
  return [{type: "rect", yref: "paper", y0: 0, y1: 1, x0: brush.from, x1: brush.to, layer: "below",
    line: {width: 0}, fillcolor: faint("brush", 0.28), name: "brushed"}];
}

/** The brushed stretch in a view: its samples one by one, or a line where the view is made of many. */
function stretch(name) {
  const {x, y} = VIEWS[name];
  const part = brushed?.[name];
  if (!part?.[x]?.length) return [];
  const single = Boolean(part.residual_um);
  const marker = {size: single ? 2.5 : 4, color: colour("brush"), opacity: single ? 0.7 : 1};
  return [line("stretch", part[x], part.residual_um ?? part[y], {colour: colour("brush"), width: 2.2, mode: single ? "markers" : "lines+markers", marker, ...SILENT})];
}

/** An axis of the whole view, whatever is marked in it. */
function within(values, log) {
  const known = values.filter((value) => !log || value > 0);
  const [low, high] = [Math.min(...known), Math.max(...known)];
  if (log) return {...logAxis(known), range: [Math.log10(low) - 0.05, Math.log10(high) + 0.05], autorange: false};
  const margin = 0.02 * (high - low) || 1;
  return {type: "linear", range: [low - margin, high + margin], autorange: false, nticks: 4};
}

function drawView(name) {
  const box = byId(name);
  const {x, y, log, logY} = VIEWS[name];
  const of = views[name];
  const empty = !of?.[x]?.length;
  nothing(box, empty ? "none in this record" : null);
  const unit = units().y;
  const signed = Boolean(of?.mean_um) || name === "rest";
  const data = [];
  if (!empty) {
    if (of.low_um) {
      const edge = (name, values, more = {}) =>
        line(name, of[x], values, {colour: "transparent", width: 0, ...SILENT, ...more});
      data.push(edge("low", of.low_um), edge("high", of.high_um, {fill: "tonexty", fillcolor: faint("residual", 0.16)}));
    }
    if (of.mean_um) data.push(line("mean", of[x], of.mean_um, {colour: colour("residual"), width: 1, dash: "dot", ...SILENT}));
    data.push(line({frequency: "rms in the band", rest: "mean"}[name] ?? "rms", of[x], of[y], {colour: colour("residual"), width: 1.6}));
    data.push(...stretch(name));
  }
  const noise = views.noise_um ?? store.server.noise_um;
  const shapes = [...spanOf(name), ...(noise && !logY && !empty ? [noiseBand(signed ? -noise : 0, noise)] : [])];
  draw(box, data, {
    x: {hoverformat: ".4~g", ...(empty ? {} : within(of[x], log))},
    y: logY && !empty ? within([...of[y], ...(brushed?.[name]?.[y] ?? [])], true)
      : {type: "linear", rangemode: signed ? "normal" : "tozero"},
    shapes, hover: "x",
  });
  box.setAttribute("aria-label", `Residual of ${store.ui.record} ${VIEWS[name].title(units())}${empty ? ": none in this record" : ` in ${unit}`}`);
}
