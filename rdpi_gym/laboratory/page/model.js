// The model of the present step: its core, its effects, and each parameter to drag, type, hold.

import {act, latest, post} from "./api.js";
import {byId, h, icon, replace} from "./dom.js";
import {number, typed, withUnit} from "./format.js";
import {presentStep, store, units, watch} from "./state.js";
import {judged} from "./staircase.js";
import {showTrace} from "./traces.js";

const STEPS = 1000; // of a slider
const SETTLE_MS = 900;

let dragging = null; // testid of the slider that is held
let waiting = null; // what the server said meanwhile

const ask = latest(
  (effect, parameter, value) => {
    const span = store.ui.range ?? [null, null];
    return post("/api/parameter", {
      effect, parameter, value, commit: false, record: store.ui.record, from_s: span[0], to_s: span[1],
    });
  },
  (answer, effect, parameter) => {
    if (!dragging) return;
    showTrace(answer.trace);
    told(effect, parameter, answer.errors);
  },
);

export function beginModel() {
  watch((server) => [presentStep(server)?.model, server.current, server.quantities, server.settings?.cores], drawModel);
}

function drawModel() {
  if (dragging) {
    waiting = true;
    return;
  }
  const step = presentStep(store.server);
  const box = byId("model");
  box.hidden = !step;
  if (!step) return;
  const {model} = step;
  byId("core-title").textContent = model.core_title;
  const cores = store.server.settings?.cores ?? [];
  const choice = byId("core");
  replace(choice, h("option", {value: "", selected: true}, "Other core …"), h("option", {value: "auto"}, "Let the data choose"),
    cores.filter(({key}) => key !== model.core).map(({key, title}) => h("option", {value: key}, title)));
  const shape = {name: "", title: "the hysteresis", parameters: model.core_parameters ?? []};
  const open = byId("effects").querySelector("details")?.open;
  replace(byId("effects"),
    shape.parameters.length ? h("details", {class: "effect", "data-testid": "effect-core", open},
      h("summary", {"data-testid": "core-parameters"}, "Its parameters"), shape.parameters.map((each) => parameterRow(shape, each))) : "",
    model.effects.length ? model.effects.map(effectBox) : h("p", {class: "empty"}, "No effect yet: the hysteresis alone. Add one below."));
}

function effectBox(effect) {
  return h("section", {class: "effect", "data-testid": `effect-${effect.name}`, "aria-label": effect.title},
    h("header", {},
      h("h3", {}, effect.title, effect.form ? h("span", {class: "form"}, effect.form.replaceAll("_", " ")) : ""),
      h("button", {
        type: "button", class: "quiet", "data-testid": `remove-${effect.name}`, "aria-label": `Take out ${effect.title}`,
        title: "Take it out and refit everything", onclick: () => act("/api/remove", {effect: effect.name}),
      }, "Take out")),
    effect.parameters.filter(({fixed}) => !fixed).map((parameter) => parameterRow(effect, parameter)));
}

/** A slider's place for a value, and back. */
function scale({value, low, high, log}) {
  const spread = Math.max(Math.abs(value), 1e-12);
  const least = low ?? (log ? spread / 100 : value - 3 * spread);
  const most = high ?? (log ? spread * 100 : value + 3 * spread);
  const logarithmic = log && least > 0;
  const [a, b] = logarithmic ? [Math.log(least), Math.log(most)] : [least, most];
  return {
    place: (x) => Math.round((STEPS * ((logarithmic ? Math.log(Math.max(x, least)) : x) - a)) / (b - a)),
    value: (place) => {
      const x = a + ((b - a) * place) / STEPS;
      return logarithmic ? Math.exp(x) : x;
    },
    least, most,
  };
}

const idOf = (effect, parameter) => `${effect || "core"}-${parameter}`;

function parameterRow(effect, parameter) {
  const {name, symbol, unit, value, standard_error: spread, held} = parameter;
  const id = idOf(effect.name, name);
  const to = scale(parameter);
  const says = `${name.replaceAll("_", " ")} of ${effect.title}${unit ? `, ${unit}` : ""}`;
  const slider = h("input", {type: "range", min: "0", max: String(STEPS), value: String(to.place(value)),
    "data-testid": `slider-${id}`, "aria-label": says, "aria-valuetext": withUnit(value, unit)});
  const field = h("input", {type: "text", inputmode: "decimal", class: "value", value: typed(value, 4), "data-testid": `value-${id}`, "aria-label": `${says}, exact`});
  const set = (x, commit) => (commit
    ? act("/api/parameter", {effect: effect.name, parameter: name, value: x, commit: true, record: store.ui.record})
    : ask(effect.name, name, x));
  const end = () => {
    dragging = null;
    if (waiting) {
      waiting = null;
      drawModel();
    }
  };
  slider.addEventListener("input", () => {
    dragging = id;
    const x = to.value(Number(slider.value));
    field.value = typed(x, 4);
    slider.setAttribute("aria-valuetext", withUnit(x, unit));
    set(x, false);
  });
  const keep = async () => {
    clearTimeout(settling);
    settling = null;
    ask.forget();
    const x = to.value(Number(slider.value));
    dragging = null;
    if (!await set(x, true)) drawModel();
    end();
  };
  // a pointer lets go once; keys move step by step, and what they end at is one step of the staircase
  let byKeys = false;
  let settling = null;
  slider.addEventListener("pointerdown", () => { byKeys = false; });
  slider.addEventListener("keydown", () => { byKeys = true; });
  slider.addEventListener("change", () => {
    clearTimeout(settling);
    if (byKeys) settling = setTimeout(keep, SETTLE_MS);
    else keep();
  });
  slider.addEventListener("blur", () => { if (settling) keep(); });
  field.addEventListener("change", async () => {
    const x = Number(field.value);
    if (!field.value.trim() || !Number.isFinite(x)) field.value = typed(value, 4);
    else if (!await set(x, true)) field.value = typed(value, 4);
  });
  return h("div", {class: "parameter"},
    h("span", {class: "name"}, symbol || name.replaceAll("_", " ")),
    h("span", {class: "typed"}, field, h("span", {class: "unit"}, unit)),
    h("button", {
      type: "button", class: "quiet lock", "data-testid": `hold-${id}`, "aria-pressed": String(Boolean(held)),
      "aria-label": `Hold ${says}`, title: held ? "Held: refits leave it as it is" : "Free: refits move it",
      onclick: () => act("/api/hold", {effect: effect.name, parameter: name, held: !held}),
    }, icon(held ? "hold" : "free")),
    slider,
    h("span", {class: "spread", "data-testid": `spread-${id}`}, held ? "held" : spread ? `± ${number(spread, 2)} ${unit}` : ""));
}

/** While a slider is dragged: what the error becomes. */
function told(effect, parameter, errors) {
  const now = judged(presentStep(store.server).errors);
  const box = document.querySelector(`[data-testid="${CSS.escape(`spread-${idOf(effect, parameter)}`)}"]`);
  if (box) box.textContent = `error ${number(now)} → ${number(judged(errors))} ${units().y}`;
}

export function beginCore() {
  byId("refit").addEventListener("click", () => act("/api/refit"));
  watch((server) => Boolean(server.job), (busy) => { byId("refit").disabled = busy; });
  byId("core").addEventListener("change", (event) => {
    if (event.target.value) act("/api/core", {core: event.target.value});
    event.target.value = "";
  });
}

