// Light and dark, and how every plot looks in them. The colours stand in lab.css, once.

import {byId} from "./dom.js";
import {redraw, setUi, store, units} from "./state.js";

const KEPT = "rdpi-lab-theme";

export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

/** A colour with less of itself, for bands and highlights. */
export function faint(name, share) {
  const hex = colour(name).replace("#", "");
  const [r, g, b] = [0, 2, 4].map((i) => parseInt(hex.slice(i, i + 2), 16));
  return `rgba(${r},${g},${b},${share})`;
}

export function beginLook() {
  let kept = null;
  try {
    kept = localStorage.getItem(KEPT);
  } catch {
    kept = null; // storage is switched off: the system's choice holds
  }
  apply(kept ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
}

export function otherTheme() {
  const theme = store.ui.theme === "dark" ? "light" : "dark";
  apply(theme);
  try {
    localStorage.setItem(KEPT, theme);
  } catch {
    // it holds until the page is closed
  }
  redraw();
}

function apply(theme) {
  document.documentElement.dataset.theme = theme;
  setUi({theme});
}

/** What the reader wrote is text in a plot, too, and no markup. */
export const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

const CONFIG = {displayModeBar: false, scrollZoom: false, doubleClick: false, responsive: false};

// The page is there before Plotly is; what is drawn meanwhile waits, the last of each box.
const waiting = new Map();

function drawWaiting() {
  for (const [box, rest] of waiting) draw(box, ...rest);
  waiting.clear();
}

if (!globalThis.Plotly) byId("plotly").addEventListener("load", drawWaiting);

/** Draw into a box; `x` and `y` override the axes of the house. */
export function draw(box, data, options = {}) {
  if (globalThis.Plotly) return drawNow(box, data, options);
  waiting.set(box, [data, options]);
  return null;
}

function drawNow(box, data, {x = {}, y = {}, y2 = null, shapes = [], margin = {}, hover = "x"} = {}) {
  const axis = {
    gridcolor: colour("line"), linecolor: colour("edge"), zerolinecolor: colour("edge"), zerolinewidth: 1,
    showline: true, ticks: "outside", ticklen: 3, tickcolor: colour("edge"), fixedrange: true,
    tickfont: {size: 10.5, color: colour("muted")}, nticks: 6, exponentformat: "power", minexponent: 4,
  };
  const layout = {
    autosize: true, dragmode: false, hovermode: hover, showlegend: false, shapes,
    font: {family: getComputedStyle(document.body).fontFamily, size: 11, color: colour("ink")},
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    margin: {l: 46, r: 10, t: 6, b: 20, ...margin},
    hoverlabel: {font: {size: 11, color: colour("ink")}, bgcolor: colour("paper"), bordercolor: colour("edge")},
    hoverdistance: 30,
    xaxis: {...axis, tickangle: 0, nticks: 5, ...x}, yaxis: {...axis, nticks: 5, autorange: true, ...y},
    ...(y2 ? {yaxis2: {...axis, ...y2}} : {}),
  };
  follow(box);
  return globalThis.Plotly.react(box, data, layout, CONFIG);
}

const sizes = new ResizeObserver((entries) => {
  for (const {target} of entries) {
    if (target.classList.contains("js-plotly-plot") && target.offsetWidth > 0) globalThis.Plotly.Plots.resize(target);
  }
});

function follow(box) {
  if (box.dataset.follows) return;
  box.dataset.follows = "yes";
  sizes.observe(box);
}

/** Say why a plot has nothing to show; null: it has. */
export function nothing(box, why) {
  const {dataset} = box.closest("figure");
  if (why) dataset.none = why;
  else delete dataset.none;
}

/** A logarithmic axis with as many ticks as its values need. */
export function logAxis(values) {
  const known = values.filter((value) => value > 0);
  const decades = Math.log10(Math.max(...known) / Math.min(...known));
  return {type: "log", dtick: decades > 1.2 ? Math.max(1, Math.ceil(decades / 5)) : "D2", tickformat: "~g"};
}

/** Look of a model over what was measured, which shows through its gaps. */
export const OVER = {width: 1.4, dash: "4px,3px"};

/** A line of a plot, its hover text with the unit. */
export function line(name, x, y, {colour: of, width = 1.4, dash = "solid", unit = units().y, digits = 4, ...more} = {}) {
  return {
    type: "scatter", mode: "lines", name, x, y, line: {color: of, width, dash},
    hovertemplate: `%{y:.${digits}~g} ${plain(unit)}<extra>${plain(name)}</extra>`, ...more,
  };
}

/** The band of the noise floor: nothing within it can be told from noise. */
export const noiseBand = (low, high) => ({
  type: "rect", xref: "paper", x0: 0, x1: 1, y0: low, y1: high, yref: "y", layer: "below",
  line: {width: 0}, fillcolor: faint("falling", 0.16), name: "noise",
});
