// What the page says of itself: the sentence on top, the job that runs, what went wrong.

import {act} from "./api.js";
import {byId} from "./dom.js";
import {count, number} from "./format.js";
import {presentStep, setUi, store, watch} from "./state.js";

export function beginStatus() {
  watch((server) => [server.title, server.session_folder], ([title, folder]) => {
    byId("title").textContent = title || "No data yet";
    byId("title").title = folder;
    document.title = title ? `${title} · rdpi lab` : "rdpi lab";
    byId("session-folder").textContent = folder;
  });
  watch((server, ui) => [server.sentence, server.current, server.records.length, server.job?.what, ui.loaded], ([sentence, current, records]) => {
    byId("sentence").textContent = sentence ?? (records && !current ? "The base model is being fitted." : "");
  });
  watch((server) => server.job, drawJob);
  byId("cancel").addEventListener("click", cancel);
  watch((server, ui) => [ui.connection, ui.notice, server.problem, server.session_folder], drawAlert);
  byId("alert-close").addEventListener("click", () => setUi({notice: null}));
  watch((server) => [server.job?.what, server.ranking?.status, presentStep(server)?.label], announce);
  watch((server, ui) => ui.loaded, (loaded) => document.body.classList.toggle("loaded", loaded));
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
