// What the page knows: the server's state, and what the reader looks at. Parts of the page watch what they show.

const watchers = [];
let due = false;

const NOTHING = {
  told: 0, title: "", session_folder: "", problem: null, quantities: null, files: [], records: [], settings: {}, noise_um: null,
  steps: {}, path: [], redo: [], current: null, sentence: null, ranking: null, job: null, payoff: null,
};

/** `server`: the state of the session; `ui`: what is looked at; it never reaches the server. */
export const store = {
  server: NOTHING,
  ui: {
    record: null, // its name
    blind: false, // whether it was chosen before anything was fitted, and by nobody
    range: null, // [from_s, to_s] that the traces show; null: all of the record
    mode: "brush", // what dragging on a plot does
    brush: null, // {by: "time" | view, from, to}
    preview: null, // effect whose residual is drawn over the present one
    connection: "open", // "lost" | "refused"
    notice: null, // a sentence for the reader
    theme: "light",
    loaded: false, // whether the server has told its state
  },
};

/**
 * Take the state that the server tells, unless a later one is here already: what is pushed and what is
 * answered come by two ways, and either may overtake the other. A server that is begun `anew` counts anew.
 */
export function setServer(state, {anew = false} = {}) {
  if (!anew && state.told < store.server.told) return;
  store.server = state;
  const names = state.records.map((record) => record.name);
  const {record, blind} = store.ui;
  store.ui = {...store.ui, loaded: true};
  if (!names.includes(record) || (blind && state.current)) {
    store.ui = {...store.ui, record: worst(state), blind: !state.current, range: null, brush: null, preview: null};
  }
  changed();
}

export function setUi(patch) {
  store.ui = {...store.ui, ...patch};
  changed();
}

/** Put one card into the ranking that runs. */
export function setCard(card) {
  const {ranking} = store.server;
  if (!ranking || (card.step && card.step !== ranking.step)) return;
  const cards = ranking.cards.filter((other) => other.effect !== card.effect);
  store.server = {...store.server, ranking: {...ranking, cards: [...cards, card]}};
  changed();
}

export function setProgress(progress) {
  if (!store.server.job) return;
  store.server = {...store.server, job: {...store.server.job, ...progress}};
  changed();
}

/** Call `render` now and whenever what `select` returns is another. */
export function watch(select, render) {
  watchers.push({select, render, seen: undefined});
  changed();
}

function changed() {
  if (due) return;
  due = true;
  queueMicrotask(() => {
    due = false;
    for (const watcher of watchers) {
      const value = watcher.select(store.server, store.ui);
      const seen = JSON.stringify(value ?? null);
      if (seen === watcher.seen) continue;
      watcher.seen = seen;
      watcher.render(value);
    }
  });
}

/** Forget what was drawn, so that everything is drawn again (in other colours, say). */
export function redraw() {
  for (const watcher of watchers) watcher.seen = undefined;
  changed();
}

/** The record that a page opens on: the one with the largest error, or the first that is fitted. */
function worst(state) {
  const of = state.steps?.[state.current]?.errors?.by_record_um ?? {};
  const used = state.records.filter((record) => ["train", "validation"].includes(record.role));
  const sorted = [...used].sort((a, b) => (of[b.name] ?? 0) - (of[a.name] ?? 0));
  return (sorted[0] ?? state.records[0])?.name ?? null;
}

export const presentStep = (state) => (state?.current ? state.steps[state.current] : null);
export const recordNamed = (state, name) => state?.records.find((record) => record.name === name) ?? null;

/** Units to show: {u, y}. */
export const units = () => ({
  u: store.server.quantities?.input?.unit ?? "V",
  y: store.server.quantities?.output?.unit ?? "µm",
});
export const symbols = () => ({
  u: store.server.quantities?.input?.symbol ?? "u",
  y: store.server.quantities?.output?.symbol ?? "y",
});
