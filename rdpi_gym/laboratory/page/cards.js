// What may be missing: a card for every candidate, sorted by what is known of it so far.

import {act} from "./api.js";
import {byId, h, still} from "./dom.js";
import {count, number, percent, withUnit} from "./format.js";
import {signature} from "./signature.js";
import {setUi, store, units, watch} from "./state.js";

const MOVE_MS = 220;
const HELD_MS = 1500; // no card moves away from under a pointer that has just moved
const PREVIEW_MS = 90;
const LEAST = 0.005; // of the squared error above noise
const SOME = 0.05; // of it: less is no reason to be sure of anything
const NAMED = 2; // of rivals; all of them stand behind "More"

const STATES = {
  waiting: "waiting", refitting: "refitting", tried: "tried", final: "", failed: "not fitted",
};
const AFTER = {tried: 0, final: 0, refitting: 1, waiting: 2, failed: 3};

const nodes = new Map(); // effect: {node, seen, effect, known}
let pointed = -Infinity; // when the pointer last moved over the cards
let later = null;
let hovering = null;
let folded = true; // candidates that remove nothing

export function beginCards() {
  const list = byId("cards");
  list.addEventListener("pointermove", () => { pointed = performance.now(); });
  list.addEventListener("pointerleave", () => {
    pointed = -Infinity;
    preview(null);
  });
  const focused = (event) => nodes.get(event.target.closest("li")?.dataset.testid.slice("card-".length));
  list.addEventListener("focusin", (event) => {
    if (focused(event)?.known) preview(focused(event).effect);
  });
  list.addEventListener("focusout", () => preview(null));
  byId("spare").addEventListener("click", () => {
    folded = !folded;
    drawCards();
  });
  watch((server) => [server.ranking, server.current, server.quantities, server.noise_um], drawCards);
  watch((server, ui) => ui.preview, (effect) => {
    for (const [name, {node}] of nodes) node.classList.toggle("previewed", name === effect);
  });
  watch((server) => [server.ranking?.verdict, server.ranking?.settled, server.ranking?.status, server.ranking?.lines, server.job?.what, server.current, server.records.length], drawVerdict);
}

/** Cards in the order in which they stand: while they are refitted by error, at the end as the server ranks them. */
export function sorted({cards, status}) {
  const late = (card) => (card.added ? 4 : AFTER[card.state] ?? 3);
  const error = (card) => card.validation_um ?? Infinity;
  const placed = cards.map((card, place) => ({card, place: status === "done" ? place : 0}));
  placed.sort((a, b) => late(a.card) - late(b.card) || a.place - b.place ||
    (error(a.card) === error(b.card) ? 0 : error(a.card) - error(b.card)) || a.card.title.localeCompare(b.card.title));
  return placed.map(({card}) => card);
}

const NONE = {cards: [], status: null};

export const add = (effect) => {
  pointed = -Infinity;
  preview(null);
  return act("/api/add", {effect});
};

/** Add the card that stands at a place (1 is the first). */
export function addAt(place) {
  const card = sorted(store.server.ranking ?? NONE).filter((each) => !each.added)[place - 1];
  if (card && card.state !== "failed") add(card.effect);
}

function preview(effect) {
  clearTimeout(hovering);
  hovering = setTimeout(() => setUi({preview: effect}), effect ? PREVIEW_MS : 0);
}

function drawCards() {
  const cards = sorted(store.server.ranking ?? NONE);
  for (const [effect, {node}] of nodes) {
    if (cards.some((card) => card.effect === effect)) continue;
    node.remove();
    nodes.delete(effect);
  }
  const spare = cards.filter(isSpare).length;
  byId("spare").hidden = !spare;
  byId("spare").textContent = `${folded ? "Show" : "Hide"} ${count(spare, "effect")} that ${spare === 1 ? "removes" : "remove"} nothing`;
  byId("spare").setAttribute("aria-expanded", String(!folded));
  byId("cards").classList.toggle("folded", folded);
  byId("alone").hidden = !cards.length;
  for (const card of cards) {
    const seen = JSON.stringify([card, store.server.current, units(), isSpare(card)]);
    const known = nodes.get(card.effect) ?? {node: h("li", {"data-testid": `card-${card.effect}`})};
    if (known.seen !== seen) fillCard(known.node, card);
    nodes.set(card.effect, {node: known.node, seen, effect: card.effect, known: Number.isFinite(card.validation_um)});
  }
  order(cards.map((card) => nodes.get(card.effect).node));
}

/** Whether the ranking has ended with a candidate that removes nothing: such cards are folded away. */
const isSpare = ({added, recommended, state, share}) => store.server.ranking?.status === "done" && !added && !recommended &&
  (state === "failed" || (Number.isFinite(share) && share <= LEAST));

/** Put cards in order: each glides to its place, and the one with the focus is not taken out. */
function order(wanted) {
  const list = byId("cards");
  clearTimeout(later);
  const now = [...list.children];
  const steady = now.length > 0 && list.matches(":hover") && performance.now() - pointed < HELD_MS;
  const fresh = wanted.filter((node) => node.parentElement !== list);
  if (steady) {
    list.append(...fresh);
    later = setTimeout(() => order(wanted), HELD_MS);
    return;
  }
  if (now.length === wanted.length && wanted.every((node, i) => node === now[i])) return;
  const before = new Map(now.map((node) => [node, node.getBoundingClientRect().top]));
  const focused = wanted.find((node) => node.contains(document.activeElement));
  let passed = !focused;
  for (const node of wanted) {
    if (node === focused) passed = true;
    else if (passed) list.append(node);
    else list.insertBefore(node, focused);
  }
  if (still()) return;
  for (const [node, top] of before) {
    const moved = top - node.getBoundingClientRect().top;
    if (moved && node.isConnected) {
      node.animate([{transform: `translateY(${moved}px)`}, {transform: "none"}], {duration: MOVE_MS, easing: "ease-out"});
    }
  }
}

function fillCard(node, card) {
  const {y} = units();
  const ready = !card.added && card.state !== "failed";
  const known = card.validation_um !== null && card.validation_um !== undefined;
  const open = node.querySelector(".more")?.hidden === false;
  const remarks = [...(card.remarks ?? []), ...(card.signature ? [`How it shows: ${card.signature}`] : [])];
  if (card.rivals?.length > NAMED) remarks.push(`Not told apart on these records from ${card.rivals.map(titled).join(", ")}.`);
  const has = remarks.length || card.parameters?.length;
  const focused = node.contains(document.activeElement) ? document.activeElement.dataset.testid : null;
  node.className = `card ${card.added ? "added" : card.state}${card.recommended ? " recommended" : ""}${isSpare(card) ? " spare" : ""}`;
  node.replaceChildren(
    signature(card.picture),
    h("h3", {}, card.title),
    sureness(card),
    h("div", {class: "foot"},
      h("span", {class: "error"}, known ? [h("b", {}, number(card.validation_um)), ` ${y}`] : ""),
      has ? h("button", {
        type: "button", class: "quiet", "data-testid": `more-${card.effect}`, "aria-expanded": String(Boolean(open)),
        "aria-label": `More about ${card.title}: parameters and remarks`, onclick: (event) => {
          const more = node.querySelector(".more");
          more.hidden = !more.hidden;
          event.currentTarget.setAttribute("aria-expanded", String(!more.hidden));
        },
      }, "More") : "",
      ready ? h("button", {
        type: "button", class: "add", "data-testid": `add-${card.effect}`,
        "aria-label": `Add ${card.title}${known ? `, error with it ${withUnit(card.validation_um, y)}` : ""}`,
        onclick: () => add(card.effect),
      }, "Add") : ""),
    advice(card) ? h("p", {class: "advice"}, advice(card)) : "",
    h("p", {class: "mechanism"}, card.mechanism),
    h("div", {class: "meter", "aria-hidden": "true"}, h("span", {style: {width: `${100 * Math.min(1, Math.max(0, card.share ?? 0))}%`}})),
    has ? h("div", {class: "more", hidden: !open},
      card.parameters?.length ? h("dl", {}, card.parameters.map((each) =>
        [h("dt", {}, each.symbol ?? each.name, h("span", {class: "hidden"}, ` ${each.name}`)), h("dd", {}, each.value_text)])) : "",
      remarks.map((text) => h("p", {}, text))) : "");
  if (focused) node.querySelector(`[data-testid="${CSS.escape(focused)}"]`)?.focus({preventScroll: true});
  node.onpointerenter = known ? () => preview(card.effect) : null;
  node.onpointerleave = () => preview(null);
}

/** How sure the ranking is of it, where it takes something at all; before that, how far it is. */
function sureness({probability, confidence, share, recommended, added, state}) {
  const sure = probability ?? confidence;
  if (added || sure === null || sure === undefined || !(recommended || share > SOME)) {
    return h("span", {class: "state"}, added ? "in the model" : STATES[state]);
  }
  const says = probability === null || probability === undefined
    ? "Confidence: how often it, or an effect indistinguishable from it, wins in draws of the records"
    : "Probability among the candidates";
  return h("span", {class: "probability", title: says}, percent(sure));
}

/** What it removes, whether the ranking advises it, and what these records cannot tell it from. */
function advice({share, rivals, recommended}) {
  const parts = recommended ? ["advised"] : [];
  if (share !== null && share !== undefined) parts.push(share > LEAST ? `removes ${percent(share)} of the squared error above noise` : "removes nothing");
  if (rivals?.length) parts.push(`or ${listed(rivals.slice(0, NAMED).map(titled), rivals.length - NAMED)}`);
  return parts.join(" · ");
}

const listed = (names, others) => (others > 0 ? `${names.join(", ")} and ${others} more` : names.join(" or "));

const titled = (effect) =>
  store.server.ranking?.cards.find((card) => card.effect === effect)?.title.toLowerCase() ?? effect.replaceAll("_", " ");

function drawVerdict() {
  const {ranking} = store.server;
  byId("verdict").textContent = ranking?.verdict ?? ranking?.problem ?? {
    running: "Every candidate is refitted together with the model; the order settles as they finish.",
    cancelled: "The ranking was cancelled: what was tried so far stands below.",
    failed: "The ranking failed.",
  }[ranking?.status] ?? (store.server.current ? "" : "Every candidate is tried as soon as the base model is there.");
  byId("ranking-lines").replaceChildren(...(ranking?.lines ?? []).map((text) => h("p", {class: text.startsWith("- ") ? "item" : null}, text.replace(/^- /, ""))));
  byId("ranking-more").hidden = !ranking?.lines?.length;
  const cancelled = store.server.records.length && !store.server.job && (!ranking || ["cancelled", "failed"].includes(ranking.status));
  byId("rank").hidden = !cancelled;
  byId("unknown").hidden = !(ranking?.status === "done");
  byId("settle").hidden = !ranking?.settled;
  if (ranking?.settled) {
    byId("settle").textContent = `Take it in few numbers: ${withUnit(ranking.settled.validation_um, units().y)}`;
  }
}
