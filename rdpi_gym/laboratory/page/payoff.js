// Control payoff: how well the compensators track a reference, by the model of before and by the present one.

import {act} from "./api.js";
import {byId, h, replace, svg} from "./dom.js";
import {number, typed} from "./format.js";
import {colour, draw, line} from "./look.js";
import {presentStep, store, units, watch} from "./state.js";

const KNOTS = 9;
const WIDE = 300;
const HIGH = 84;
const FINE = 40; // key presses from end to end

const heights = Array.from({length: KNOTS}, (_, i) => Number((0.5 - 0.5 * Math.cos((2 * Math.PI * i) / (KNOTS - 1))).toFixed(3)));

export function beginPayoff() {
  byId("reference").addEventListener("submit", (event) => {
    event.preventDefault();
    simulate();
  });
  byId("reference").addEventListener("change", shape);
  watch((server) => [server.current, server.records.map((record) => record.y), server.job?.what], ready);
  watch((server, ui) => [server.payoff, server.noise_um, server.quantities, ui.theme], drawPayoff);
  watch((server, ui) => [server.quantities, ui.theme], shape);
  drawing();
}

const chosen = () => byId("reference").elements.namedItem("kind").value;
const field = (name) => byId("reference").elements.namedItem(name);

function ready() {
  const {records, current, job} = store.server;
  byId("simulate").disabled = !current || job?.what === "payoff";
  const span = Math.max(...records.map(({y}) => y[1] - y[0]), 0);
  // a reference within what the stage has shown that it can do
  if (span > 0 && !field("amplitude").dataset.set) {
    field("amplitude").value = typed(0.4 * span, 2);
    field("amplitude").dataset.set = "yes";
  }
}

function shape() {
  const drawn = chosen() === "drawn";
  byId("drawn-box").hidden = !drawn;
  byId("frequency-box").hidden = drawn;
  byId("amplitude-unit").textContent = units().y;
  byId("amplitude-name").textContent = drawn ? "Height" : "Amplitude";
}

function simulate() {
  const seconds = Number(field("seconds").value);
  const amplitude = Number(field("amplitude").value);
  const reference = {kind: chosen(), amplitude_um: amplitude, frequency_hz: Number(field("frequency").value), seconds};
  if (reference.kind === "drawn") {
    reference.points = heights.map((height, i) => [(seconds * i) / (KNOTS - 1), (2 * height - 1) * amplitude]);
  }
  act("/api/payoff", {reference});
}

// A reference is drawn by knots at even times: each is a slider, for the pointer and for the arrow keys.
function drawing() {
  const box = byId("drawn");
  const x = (i) => 8 + ((WIDE - 16) * i) / (KNOTS - 1);
  const y = (height) => HIGH - 8 - (HIGH - 16) * height;
  const path = svg("polyline", {class: "with"});
  const knots = heights.map((_, i) => svg("circle", {
    r: 5, cx: x(i), tabindex: "0", role: "slider", "aria-label": `Knot ${i + 1} of ${KNOTS}`, "aria-valuemin": "0", "aria-valuemax": "100",
    "data-testid": `knot-${i}`,
  }));
  const show = () => {
    path.setAttribute("points", heights.map((height, i) => `${x(i)},${y(height)}`).join(" "));
    knots.forEach((knot, i) => {
      knot.setAttribute("cy", y(heights[i]));
      knot.setAttribute("aria-valuenow", String(Math.round(100 * heights[i])));
    });
  };
  const move = (i, height) => {
    heights[i] = Math.min(1, Math.max(0, height));
    show();
  };
  knots.forEach((knot, i) => knot.addEventListener("keydown", (event) => {
    const by = {ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1, PageUp: 5, PageDown: -5}[event.key];
    const to = {Home: 0, End: 1}[event.key];
    if (by === undefined && to === undefined) return;
    event.preventDefault();
    move(i, to ?? heights[i] + by / FINE);
  }));
  const picture = svg("svg", {viewBox: `0 0 ${WIDE} ${HIGH}`, class: "drawn", "aria-label": "Reference", role: "group"},
    svg("line", {x1: 0, x2: WIDE, y1: HIGH / 2, y2: HIGH / 2, class: "middle"}), path, knots);
  const under = (event) => {
    const frame = picture.getBoundingClientRect();
    const at = ((event.clientX - frame.left) / frame.width) * WIDE;
    const i = Math.min(KNOTS - 1, Math.max(0, Math.round(((at - 8) / (WIDE - 16)) * (KNOTS - 1))));
    move(i, 1 - (((event.clientY - frame.top) / frame.height) * HIGH - 8) / (HIGH - 16));
  };
  picture.addEventListener("pointerdown", (event) => {
    picture.setPointerCapture(event.pointerId);
    under(event);
  });
  picture.addEventListener("pointermove", (event) => {
    if (picture.hasPointerCapture(event.pointerId)) under(event);
  });
  box.append(picture);
  show();
}

function drawPayoff() {
  const {payoff} = store.server;
  byId("payoff-result").hidden = !payoff;
  byId("payoff-empty").hidden = Boolean(payoff);
  if (!payoff) return;
  const {y} = units();
  const stale = payoff.step !== store.server.current;
  const told = store.server.steps[payoff.step] ?? presentStep(store.server);
  byId("payoff-step").textContent = stale ? `For the model “${told?.label ?? payoff.step}”; simulate again for the present one.` : "";
  const share = (value) => (value === null || value === undefined ? "" : h("small", {}, ` ${number(value, 2)} %`));
  // what no measurement would show is no gain either
  const noise = store.server.noise_um ?? 0;
  const error = (um, percent) => (um !== null && um < noise ? ["below sensor noise"] : [number(um), share(percent)]);
  const ratio = ({before_um: before, after_um: after}) => {
    const least = Math.max(after, noise);
    if (!(least > 0) || !Number.isFinite(before) || before < noise) return "–";
    return `${after < noise ? "> " : ""}${number(before / least, 2)}×`;
  };
  replace(byId("payoff-rows"), payoff.rows.flatMap((row) => [
    h("tr", {class: row.warning ? "warned" : null},
      h("th", {scope: "row"}, row.controller),
      h("td", {}, ...error(row.before_um, row.before_percent)),
      h("td", {}, h("b", {}, ...error(row.after_um, row.after_percent))),
      h("td", {}, ratio(row))),
    row.warning ? h("tr", {class: "warning"}, h("td", {colspan: "4"}, row.warning)) : ""]));
  byId("payoff-unit").textContent = `Tracking error, rms, ${y} and % of the amplitude`;
  const {t_s: t, reference_um: reference, before_um: before, after_um: after} = payoff.trace;
  const left = (of) => of.map((value, i) => (value === null ? null : value - reference[i]));
  byId("payoff-title").textContent = `${payoff.trace.title ?? "Tracking error"}, ${y}`;
  draw(byId("payoff"), [
    line("reference (own scale)", t, reference, {colour: colour("reference"), width: 1, dash: "dot", yaxis: "y2"}),
    line("before", t, left(before), {colour: colour("rising"), width: 1.2}),
    line("after", t, left(after), {colour: colour("model"), width: 1.2}),
  ], {hover: "x unified", x: {hoverformat: ".5~g"}, y2: {overlaying: "y", visible: false}});
}
