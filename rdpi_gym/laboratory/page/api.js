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

// The secret of the address goes into a header: cookies and addresses would reach other servers and eyes.
// What is stored belongs to this address and port alone.
const KEY = "rdpi-lab-token";
let kept = ""; // where a browser stores nothing, this tab has it until it is reloaded

function token() {
  try {
    return localStorage.getItem(KEY) ?? kept;
  } catch {
    return kept;
  }
}

function keep(given) {
  kept = given;
  try {
    localStorage.setItem(KEY, given);
  } catch { /* kept in this tab alone */ }
}

const send = (path, {headers = {}, ...options} = {}) =>
  fetch(path, {...options, headers: {...headers, Authorization: `Bearer ${token()}`}});

/** Take the secret out of the address; the ticket of a browser's first address is exchanged for the token. */
async function enter() {
  const given = new URLSearchParams(location.hash.slice(1));
  if (!given.has("token") && !given.has("ticket")) return;
  history.replaceState(null, "", location.pathname);
  if (given.has("token")) keep(given.get("token"));
  else {
    const response = await fetch("/api/token", {headers: {Authorization: `Ticket ${given.get("ticket")}`}});
    const body = await response.json();
    if (!response.ok) throw new Problem(body.problem);
    keep(body.token);
  }
}

async function ask(path, options) {
  let response;
  try {
    response = await send(path, options);
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

let listening = null;

function lost() {
  if (store.ui.connection !== "open") return;
  setUi({connection: "lost"});
  listening?.abort();
  setTimeout(reconnect, RETRY_MS);
}

async function reconnect() {
  try {
    const state = await answer(await send("/api/state"));
    setUi({connection: "open", notice: null});
    setServer(state, {anew: true});
    listen();
  } catch (error) {
    if (store.ui.connection !== "refused") setTimeout(reconnect, RETRY_MS);
  }
}

/** Receive what the server pushes, until it is lost. */
export async function listen() {
  listening?.abort();
  const own = listening = new AbortController();
  const take = {state: setServer, card: setCard, progress: setProgress};
  try {
    const response = await send("/api/events", {signal: own.signal});
    if (!response.ok) await answer(response);
    const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
    let waiting = "";
    for (let {done, value} = await reader.read(); !done; {done, value} = await reader.read()) {
      const events = (waiting + value).split("\n\n");
      waiting = events.pop();
      for (const event of events) {
        const [, name, data] = /^event: (\w+)\ndata: (.*)$/.exec(event) ?? [];
        take[name]?.(JSON.parse(data));
      }
    }
  } catch (error) {
    if (own.signal.aborted) return;
  }
  if (!own.signal.aborted) lost();
}

/** Let links to files of the session be followed with the secret. */
function beginTaking() {
  document.addEventListener("click", async (event) => {
    const link = event.target.closest?.('a[download][href^="/api/"]');
    if (!link) return;
    event.preventDefault();
    try {
      const response = await send(link.getAttribute("href"));
      if (!response.ok) await answer(response);
      const name = /filename="([^"]+)"/.exec(response.headers.get("content-disposition"))?.[1] ?? "";
      const href = URL.createObjectURL(await response.blob());
      Object.assign(document.createElement("a"), {href, download: name}).click();
      setTimeout(() => URL.revokeObjectURL(href), 60_000);
    } catch (error) {
      tell(error);
    }
  });
}

/** Fetch the session and listen from then on. */
export async function begin() {
  beginTaking();
  window.addEventListener("hashchange", () => location.reload()); // an address of a later server
  try {
    await enter();
    setServer(await get("/api/state"));
    listen();
  } catch (error) {
    tell(error);
  }
}
