// The error of every step from the base model on, on a logarithmic scale; a step is gone to by a click.

import {act} from "./api.js";
import {byId, h, replace} from "./dom.js";
import {number, withUnit} from "./format.js";
import {store, units, watch} from "./state.js";

const LOW_PX = 4;
const HIGH_PX = 29;

export function beginStaircase() {
  watch(
    (server) => [server.steps, server.path, server.redo, server.current, server.noise_um, server.quantities],
    drawStaircase,
  );
  byId("undo").addEventListener("click", undo);
  byId("redo").addEventListener("click", redo);
  watch((server) => [server.path.indexOf(server.current) > 0, server.redo.length > 0], ([back, on]) => {
    byId("undo").disabled = !back;
    byId("redo").disabled = !on;
  });
}

export const undo = () => !byId("undo").disabled && act("/api/undo");
export const redo = () => !byId("redo").disabled && act("/api/redo");

/** The error that a step is judged by: on records held out, where there are any. */
export const judged = (errors) => errors.validation_um ?? errors.train_um;

function drawStaircase() {
  const {steps, path, redo: undone, current, noise_um: noise} = store.server;
  const shown = [...path, ...[...undone].reverse().filter((id) => !path.includes(id))].filter((id) => steps[id]);
  const errors = shown.map((id) => judged(steps[id].errors));
  const all = [...errors, noise].filter((value) => value > 0).map(Math.log);
  const [low, high] = [Math.min(...all), Math.max(...all)];
  const height = (value) => (high > low ? LOW_PX + ((HIGH_PX - LOW_PX) * (Math.log(value) - low)) / (high - low) : HIGH_PX);
  const {y} = units();
  const list = h("ol", {class: "steps"}, shown.map((id, i) => {
    const step = steps[id];
    const before = i > 0 ? errors[i - 1] : null;
    const later = undone.includes(id);
    const says = `${step.label}: ${withUnit(errors[i], y)} held out, ${withUnit(step.errors.train_um, y)} fitted` +
      (before ? `, before ${withUnit(before, y)}` : "") + (later ? "; undone" : "");
    return h("li", {},
      h("button", {
        type: "button", "data-testid": `step-${id}`, class: later ? "step later" : "step", title: says,
        "aria-current": id === current ? "step" : null, onclick: () => act("/api/go", {step: id}),
      },
      h("span", {class: "rise"}, h("span", {class: "bar", style: {height: `${height(errors[i])}px`}})),
      h("b", {}, number(errors[i])), h("span", {class: "hidden"}, ` ${y}, `),
      h("span", {class: "label"}, step.label), later ? h("span", {class: "hidden"}, ", undone") : ""));
  }));
  const box = byId("staircase");
  replace(box, shown.length ? [
    h("span", {class: "axis"}, `rms error on records held out, ${y}, log scale`, noise
      ? h("span", {class: "legend band"}, `noise floor ${number(noise)}`) : ""),
    h("div", {class: "scroller"}, list),
  ] : []);
  box.classList.toggle("noisy", noise > 0);
  if (noise > 0 && shown.length) box.style.setProperty("--noise", `${height(noise)}px`);
  box.querySelector("[aria-current]")?.scrollIntoView({block: "nearest", inline: "nearest"});
}
