// Residual: its portrait in words, and the next experiment as a plot and a file to play on the rig.

import {byId, h, replace} from "./dom.js";
import {count, number, time} from "./format.js";
import {colour, draw, line} from "./look.js";
import {store, symbols, units, watch} from "./state.js";

export function beginResidual() {
  watch((server) => [server.ranking?.left, server.ranking?.status, server.quantities], drawLeft);
  watch((server, ui) => [server.ranking?.left?.experiment, server.quantities, ui.theme], drawExperiment);
  byId("rate-hz").addEventListener("input", setLink);
}

function drawLeft() {
  const left = store.server.ranking?.left;
  byId("left-sentence").textContent = left?.sentence ?? (store.server.ranking?.status === "running"
    ? "The residual is judged when the ranking has ended."
    : "When the candidates are ranked, what they leave is described here.");
  replace(byId("portrait"), (left?.portrait_lines ?? []).map((text) => h("p", {}, text)));
  byId("next-experiment").textContent = left?.next_experiment ?? "";
}

function drawExperiment() {
  const experiment = store.server.ranking?.left?.experiment;
  byId("experiment-box").hidden = !experiment;
  if (!experiment) return;
  const {title, rate_hz: rate, seconds, t_s: t, u, unit} = experiment;
  const samples = count(Math.round(rate * seconds) + 1, "sample");
  byId("experiment-title").textContent = `${title}: ${time(seconds)}, ${samples} at ${number(rate)} Hz`;
  byId("experiment").setAttribute("aria-label", `Command of the next experiment over time, ${unit ?? units().u}`);
  byId("experiment-axis").textContent = `${symbols().u}, ${unit ?? units().u} over s`;
  draw(byId("experiment"), [line("command", t, u, {colour: colour("model"), unit: unit ?? units().u})], {x: {hoverformat: ".5~g"}});
  if (!byId("rate-hz").value) byId("rate-hz").value = String(Math.round(rate));
  setLink();
}

function setLink() {
  const rate = Number(byId("rate-hz").value);
  const good = Number.isFinite(rate) && rate > 0;
  const link = byId("take-experiment");
  byId("rate-hz").setAttribute("aria-invalid", String(!good));
  if (good) link.href = `/api/take/experiment.csv?rate_hz=${encodeURIComponent(rate)}`;
  else link.removeAttribute("href");
}
