// What the page says of itself: the sentence on top, the job that runs, what went wrong.

import {act} from "./api.js";
import {byId} from "./dom.js";
import {count, number, withUnit} from "./format.js";
import {judged} from "./staircase.js";
import {presentStep, setUi, store, units, watch} from "./state.js";

export function beginStatus() {
  watch((server) => [server.title, server.session_folder], ([title, folder]) => {
    byId("title").textContent = title || "No data yet";
    byId("title").title = folder;
    document.title = title ? `${title} · rdpi lab` : "rdpi lab";
    byId("session-folder").textContent = folder;
  });
  watch((server) => [server.sentence, presentStep(server)?.errors, server.records.length, Boolean(server.job), server.noise_um, server.quantities], drawSentence);
  watch((server) => [Boolean(server.current), server.records.length > 0], takeable);
  watch((server) => server.job, drawJob);
  byId("cancel").addEventListener("click", cancel);
  watch((server, ui) => [ui.connection, heard(server, ui.notice) ? null : ui.notice, server.problem, server.session_folder], drawAlert);
  byId("alert-close").addEventListener("click", () => setUi({notice: null}));
  watch((server) => [server.job?.what, server.ranking?.status, presentStep(server)?.label], announce);
  watch((server, ui) => ui.loaded, (loaded) => document.body.classList.toggle("loaded", loaded));
}

function drawSentence([sentence, errors, records, busy]) {
  const waiting = busy ? "The base model is being fitted." : "There is no model yet: press “Rank” to fit it and to try every candidate.";
  byId("sentence").textContent = sentence ?? (errors ? left(errors) : records ? waiting : "");
}

/** What is known of a step before the server has looked at it. */
function left({by_record_um: by, ...errors}) {
  const {y} = units();
  const {noise_um: noise, records} = store.server;
  const held = records.filter(({role}) => role === "validation").map(({name}) => name).filter((name) => name in by);
  const [worst] = (held.length ? held : Object.keys(by)).sort((a, b) => by[b] - by[a]);
  return `Validation error ${withUnit(judged(errors), y)}` + (noise ? `, ${number(judged(errors) / noise, 2)} times the noise` : "") +
    (worst ? `; largest on ${worst} (${withUnit(by[worst], y)}).` : ".");
}

/** What is taken home is a model: without one there is nothing behind the links. */
function takeable([model, records]) {
  for (const link of document.querySelectorAll(".home a")) {
    link.dataset.href ??= link.getAttribute("href");
    if (link.closest(".early") ? records : model) link.setAttribute("href", link.dataset.href);
    else link.removeAttribute("href");
  }
}

export const cancel = () => store.server.job && act("/api/cancel");

function drawJob(job) {
  byId("job").hidden = !job;
  if (!job) return;
  const known = job.total > 0;
  byId("job-label").textContent = job.label;
  byId("job-stage").textContent = [
    job.stage && job.stage !== job.label ? job.stage : "",
    known ? `${job.done} of ${job.total}` : "",
    job.seconds === null || job.seconds === undefined ? "" : `${number(job.seconds, job.seconds < 10 ? 2 : 3)} s`,
  ].filter(Boolean).join(" · ");
  const bar = byId("job-bar");
  if (known) {
    bar.max = job.total;
    bar.value = job.done;
  } else bar.removeAttribute("value");
}

/** Whether a notice stands beside the file that it is about. */
const heard = (server, notice) => server.files.some(({problem}) => problem === notice);

function drawAlert([connection, notice, problem, folder]) {
  const say = {
    lost: "The laboratory’s server has stopped; nothing is lost. Start it again with " +
      `“rdpi lab --session ${folder || "FOLDER"}” and open the address that it prints; if it comes back by itself, this page goes on.`,
    refused: "This page belongs to a server that has ended. Open the address that “rdpi lab” printed last.",
  }[connection] ?? notice ?? problem;
  byId("alert").hidden = !say;
  byId("alert").classList.toggle("grave", connection !== "open");
  byId("alert-text").textContent = say ?? "";
  byId("alert-close").hidden = connection !== "open" || !notice;
  document.body.classList.toggle("lost", connection !== "open");
}

/** For those who hear the page: what changed, once. */
function announce([what, status, label]) {
  const cards = store.server.ranking?.cards.length ?? 0;
  byId("spoken").textContent = what ? `${store.server.job.label}.`
    : status === "done" ? `${label}. ${count(cards, "candidate")} ranked. ${store.server.ranking.verdict ?? ""}` : label ?? "";
}
