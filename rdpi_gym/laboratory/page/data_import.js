// Bring data: files and folders dropped or chosen, exercises and measured examples from a list.

import {Problem, act, get, put, tell} from "./api.js";
import {byId, h, replace} from "./dom.js";
import {count, whole} from "./format.js";
import {setUi, watch} from "./state.js";

let examples = null;

export function beginDataImport() {
  const zone = byId("drop");
  const over = (on) => () => zone.classList.toggle("over", on);
  // a file may be let go of anywhere on the page
  for (const type of ["dragenter", "dragover", "dragleave", "drop"]) {
    document.addEventListener(type, (event) => {
      if (!event.dataTransfer?.types?.includes("Files")) return;
      event.preventDefault();
      over(type === "dragenter" || type === "dragover")();
      document.body.classList.toggle("dropping", type === "dragenter" || type === "dragover");
      if (type === "drop") dropped(event.dataTransfer);
    });
  }
  for (const [button, input] of [["choose-files", "files-input"], ["choose-folder", "folder-input"]]) {
    byId(button).addEventListener("click", () => byId(input).click());
    byId(input).addEventListener("change", () => {
      bring([...byId(input).files]);
      byId(input).value = "";
    });
  }
  byId("bring").addEventListener("click", openDataImport);
  byId("bring-close").addEventListener("click", () => byId("bringing").close());
  watch((server, ui) => [server.records.length > 0, ui.loaded], ([records, loaded]) => {
    document.body.classList.toggle("no-data", !records);
    if (!loaded) return;
    // without a record the page itself is the place to drop one
    if (!records) byId("bringing").close();
    const home = records ? byId("bringing-slot") : byId("welcome-slot");
    if (byId("bring-box").parentElement !== home) home.append(byId("bring-box"));
    listExamples();
  });
}

export function openDataImport() {
  if (document.body.classList.contains("no-data")) byId("choose-files").focus();
  else if (!byId("bringing").open) byId("bringing").showModal();
}

async function listExamples() {
  if (examples) return;
  examples = [];
  try {
    examples = await get("/api/examples");
  } catch (error) {
    examples = null;
    tell(error);
    return;
  }
  const entry = ({key, title, text, records, samples}) => h("li", {},
    h("button", {type: "button", "data-testid": `example-${key}`, onclick: () => take(key)},
      h("strong", {}, title), h("span", {}, text),
      h("small", {}, [records && count(records, "record"), samples && `${whole(samples)} samples`].filter(Boolean).join(", "))));
  for (const kind of ["exercise", "measured"]) {
    replace(byId(`examples-${kind}`), examples.filter((each) => each.kind === kind).map(entry));
  }
}

async function take(key) {
  byId("bringing").close();
  await act("/api/example", {key});
}

/** Files of what was let go of; folders are walked through. */
async function dropped(transfer) {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  bring(entries.length ? (await Promise.all(entries.map(walk))).flat() : [...transfer.files]);
}

function walk(entry) {
  if (entry.isFile) return new Promise((done, failed) => { entry.file((file) => done([file]), failed); });
  const reader = entry.createReader();
  const batch = () => new Promise((done, failed) => { reader.readEntries(done, failed); });
  return (async () => {
    const found = [];
    // a browser hands out a hundred at a time
    for (let some = await batch(); some.length; some = await batch()) found.push(...some);
    return (await Promise.all(found.map(walk))).flat();
  })();
}

async function bring(files) {
  const wanted = files.filter((file) => !file.name.startsWith("."));
  if (!wanted.length) return;
  byId("bringing").close();
  const told = byId("uploading");
  const refused = [];
  try {
    for (const [i, file] of wanted.entries()) {
      told.textContent = `Reading ${file.name} (${i + 1} of ${wanted.length})`;
      try {
        await put(`/api/files/${encodeURIComponent(file.name)}`, file);
      } catch (error) {
        if (!(error instanceof Problem)) throw error;
        refused.push(error.message); // a folder may hold what is no record: the others are taken
      }
    }
    told.textContent = "Looking at the records";
    if (refused.length < wanted.length) await act("/api/open");
    if (refused.length) setUi({notice: refused[0] + (refused.length > 1 ? `; ${count(refused.length - 1, "more file")} left aside, too` : "")});
  } catch (error) {
    tell(error);
  } finally {
    told.textContent = "";
  }
}
