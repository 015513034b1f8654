// The server: actions, questions, and what it pushes.

import {setCard, setProgress, setServer, setUi, store} from "./state.js";

const RETRY_MS = 1000;

/** What the server refused, in its own one line. */
export class Problem extends Error {}

async function answer(response) {
  let body = null;
  try {
    body = await response.json();
  } catch {
    body = null;
  }
  if (response.status === 403) setUi({connection: "refused"});
  if (!response.ok) throw new Problem(body?.problem ?? `The server answered ${response.status}.`);
  return body;
}

async function ask(path, options) {
  let response;
  try {
    response = await fetch(path, {credentials: "same-origin", ...options});
  } catch (error) {
    if (error.name !== "AbortError") lost();
    throw error;
  }
  return answer(response);
}

export function get(path, parameters = {}) {
  const given = Object.entries(parameters).filter(([, value]) => value !== null && value !== undefined);
  const query = new URLSearchParams(given).toString();
  return ask(query ? `${path}?${query}` : path);
}

export const post = (path, body = {}) =>
  ask(path, {method: "POST", headers: {"Content-Type": "application/json"}, body: JSON.stringify(body)});

export const put = (path, file) =>
  ask(path, {method: "PUT", headers: {"Content-Type": "application/octet-stream"}, body: file});

export const remove = (path) => ask(path, {method: "DELETE"});

/** Do something that changes the session; what is refused is told to the reader. Returns whether it was done. */
export async function act(path, body = {}, send = post) {
  try {
    const state = await send(path, body);
    setUi({notice: null});
    if (state?.records) setServer(state);
    return true;
  } catch (error) {
    tell(error);
    return false;
  }
}

/** Tell the reader what went wrong; that the server is gone stands on the page already. */
export function tell(error) {
  if (error instanceof Problem) setUi({notice: error.message});
  else if (error.name !== "AbortError" && store.ui.connection === "open") setUi({notice: String(error.message)});
}

/**
 * Ask only as fast as answers come, and hand on only the last: of questions that pile up while one is
 * on its way, all but the newest are dropped.
 */
export function latest(question, draw) {
  let waiting = null;
  let busy = false;
  async function run() {
    busy = true;
    while (waiting) {
      const asked = waiting;
      const of = store.server;
      waiting = null;
      try {
        const body = await question(...asked);
        if (!waiting) draw(body, ...asked);
      } catch (error) {
        // of a session that has gone on meanwhile, nobody has to hear that its past is gone
        if (!waiting && store.server === of) tell(error);
      }
    }
    busy = false;
  }
  const request = (...asked) => {
    waiting = asked;
    if (!busy) run();
  };
  request.forget = () => { waiting = null; };
  return request;
}

let source = null;

function lost() {
  if (store.ui.connection !== "open") return;
  setUi({connection: "lost"});
  source?.close();
  source = null;
  setTimeout(reconnect, RETRY_MS);
}

async function reconnect() {
  try {
    const response = await fetch("/api/state", {credentials: "same-origin"});
    const state = await answer(response);
    setUi({connection: "open", notice: null});
    setServer(state, {anew: true});
    listen();
  } catch (error) {
    if (store.ui.connection !== "refused") setTimeout(reconnect, RETRY_MS);
  }
}

/** Begin to receive what the server pushes. */
export function listen() {
  source?.close();
  source = new EventSource("/api/events");
  const on = (name, take) => source.addEventListener(name, (event) => take(JSON.parse(event.data)));
  on("state", setServer);
  on("card", setCard);
  on("progress", setProgress);
  source.onerror = lost;
}

/** Fetch the session and listen from then on. */
export async function begin() {
  try {
    setServer(await get("/api/state"));
    listen();
  } catch (error) {
    tell(error);
  }
}
