// The sketch of what an effect does: a line without it, a line with it, nothing else.

import {svg} from "./dom.js";

const WIDE = 64;
const HIGH = 38;
const EDGE = 3;

const finite = (values) => values.filter((value) => Number.isFinite(value));

/** Draw points into a small box, by the scale of all of them: thumbnails of loops, signals, signatures. */
export function sketch(lines, {wide = WIDE, high = HIGH, name = null} = {}) {
  const xs = finite(lines.flatMap(({x}) => x));
  const ys = finite(lines.flatMap(({y}) => y));
  const scale = (low, high_, from, to) => (value) => (high_ > low ? from + ((to - from) * (value - low)) / (high_ - low) : 0.5 * (from + to));
  const px = scale(Math.min(...xs), Math.max(...xs), EDGE, wide - EDGE);
  const py = scale(Math.min(...ys), Math.max(...ys), high - EDGE, EDGE);
  const points = ({x, y}) => x.map((value, i) => [value, y[i]]).filter(([a, b]) => Number.isFinite(a) && Number.isFinite(b))
    .map(([a, b]) => `${px(a).toFixed(1)},${py(b).toFixed(1)}`).join(" ");
  return svg("svg", {viewBox: `0 0 ${wide} ${high}`, class: "sketch", width: wide, height: high,
    ...(name ? {role: "img", "aria-label": name} : {"aria-hidden": "true"})},
  lines.map((each) => svg("polyline", {points: points(each), class: each.kind})));
}

/** The signature on a card; what is given beside x and y is the same without the effect. */
export function signature(picture) {
  if (!picture?.x?.length) return sketch([], {});
  const without = picture.without ?? picture.y0;
  const lines = [{x: picture.x, y: picture.y, kind: "with"}];
  if (without) lines.unshift({x: picture.x0 ?? picture.x, y: without, kind: "without"});
  return sketch(lines);
}
