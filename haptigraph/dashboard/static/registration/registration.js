/** The registration page: opens a source, hands drags to the draft, shows what the server says of it, saves. */

import * as desk from "./desk.js";
import { History, edits } from "./draft.js";
import { Handles } from "./handles.js";
import { Loupe } from "./loupe.js";
import { Trocars } from "./trocars.js";

const PROGRESS_MS = 500;
const $ = (id) => document.getElementById(id);

let opened = null;  // the source, as the server found it
let history = null;
let checked = null;  // the server's newest answer, and the draft it is about
let savedDraft = null;
let starts = false;
let outline_px = [];

const loupe = new Loupe($("loupe"), $("image"), $("overlay"));
const handles = new Handles($("overlay"), move);
handles.onLook = (at) => { if (history) loupe.look(at, history.now, outline_px); };
handles.onDrop = ({ kind }) => {
  snapsTarget = kind === "target";
  if (checked?.draft === history.now) snap();
  history.settle();
};
handles.onRemove = ({ kind, index }) => { if (kind === "trocar") removeTrocar(index); };
const trocars = new Trocars($("trocars"), $("add"), {
  used: (index) => put(edits.used(history.now, index), ""),
  rename: (index, name) => put(edits.rename(history.now, index, name), `rename ${index}`),
  remove: removeTrocar,
  add() {
    put(edits.addTrocar(history.now, outline_px), "");
    handles.focus(`trocar ${history.now.trocars.length - 1}`);
  },
});
let snapsTarget = false;  // as soon as the server has said where to

const checker = new desk.Checker((answer, draft) => {
  checked = { ...answer, draft };
  if (draft === history.now) {
    outline_px = answer.outline_px;
    if (snapsTarget && !handles.dragged) return snap();
  }
  handles.show(history.now, outline_px);
  return showChecked();
}, (sentence) => { checked = null; verdict(sentence, true); showButtons(); });

/** Move a target that was let go near the retina onto it, as a part of the drag. */
function snap() {
  if (snapsTarget && checked.target_on_retina_px) history.now = edits.targetTo(history.now, checked.target_on_retina_px);
  snapsTarget = false;
  show();
}

function move({ kind, index, at }, step, how) {
  const draft = history.now, together = $("together").checked, what = `${kind} ${index ?? ""} ${how}`;
  if (kind === "radius") {
    const factor = scaleOf(at, step);
    outline_px = outline_px.map(([x, y]) => [draft.center_px[0] + (x - draft.center_px[0]) * factor, draft.center_px[1] + (y - draft.center_px[1]) * factor]);
    return put(edits.radius(draft, factor, together), what);
  }
  if (kind === "center") {
    outline_px = outline_px.map(([x, y]) => [x + step[0], y + step[1]]);
    return put(edits.center(draft, step, together), what);
  }
  if (kind === "target") return put(edits.target(draft, step), what);
  return put(edits[kind](draft, index, step), what);
}

function removeTrocar(index) {
  if (history.now.trocars.length > 1) put(edits.removeTrocar(history.now, index), "");
}

/** How much larger the globe becomes when its edge moves so. */
function scaleOf([x, y], [dx, dy]) {
  const [cx, cy] = history.now.center_px;
  const before = Math.hypot(x - cx, y - cy);
  const along = ((x - cx) * dx + (y - cy) * dy) / before;
  return Math.max(before + along, 5) / before;
}

function put(draft, what) { history.put(draft, what); show(); }

/** Show the present draft, and ask what there is to say of it. */
function show() {
  const draft = history.now;
  handles.show(draft, outline_px);
  trocars.show(draft);
  if (document.activeElement !== $("diameter")) $("diameter").value = draft.diameter_mm;
  $("mirrored").checked = draft.mirrored;
  checker.check(opened.number, draft);
  showButtons();
}

function showButtons() {
  $("undo").disabled = !history?.past.length;
  $("redo").disabled = !history?.future.length;
  $("again").disabled = !history || history.now === history.found;
  $("load").disabled = !history;
  $("save-button").disabled = !checked || checked.draft !== history?.now || Boolean(checked.problem);
}

function showChecked() {
  $("rows").replaceChildren(...checked.rows.flatMap(row));
  if (checked.problem) verdict(checked.problem, true);
  else if (savedDraft !== checked.draft) verdict(`A run would take this: ${checked.mm_per_px.toFixed(5)} mm/px.`);
  showButtons();
}

/** Return the two lines of the table that tell one thing. */
function row({ what, where, off_px, off_mm, note, is_plausible }) {
  const figures = document.createElement("tr"), words = document.createElement("tr");
  const first = figures.insertCell(), said = words.insertCell();
  const ink = { Globe: "globe", Retina: "retina", Target: "target", Trocar: "trocar" }[what.split(" ")[0]];
  if (ink) { first.append(document.createElement("i")); first.firstChild.style.setProperty("--own", `var(--${ink})`); }
  first.append(what);
  figures.insertCell().textContent = off_px?.toFixed(2) ?? "";
  figures.insertCell().textContent = off_mm?.toFixed(3) ?? "";
  words.className = is_plausible ? "words" : "words bad";
  said.colSpan = 3;
  said.textContent = [where, note].filter(Boolean).join("; ");
  return [figures, words];
}

function verdict(sentence, isBad = false) {
  $("verdict").textContent = sentence;
  $("verdict").classList.toggle("bad", isBad);
}

async function open(event) {
  event?.preventDefault();
  const button = $("open").querySelector("button"), panel = document.querySelector(".picture");
  button.disabled = true;
  panel.classList.add("busy");
  $("waiting").hidden = false;
  $("waiting").textContent = "Opening";
  const asking = setInterval(async () => {
    const { progress } = await desk.progress().catch(() => ({}));
    if (button.disabled && progress) $("waiting").textContent = `${progress[0].toUpperCase()}${progress.slice(1)}`;
  }, PROGRESS_MS);
  try {
    const { mirrored, diameter_mm } = history?.now ?? { mirrored: true, diameter_mm: 24 };
    begin(await desk.open($("source").value.trim(), mirrored, diameter_mm));
  } catch (error) {
    if (!(error instanceof desk.Refused)) throw error;
    $("waiting").textContent = opened ? "" : "No picture";
    $("waiting").hidden = Boolean(opened);
    note(error.message);
  } finally {
    clearInterval(asking);
    button.disabled = false;
    panel.classList.remove("busy");
  }
}

function begin(found) {
  opened = found;
  history = new History(found.draft);
  savedDraft = checked = null;
  outline_px = [];
  $("image").src = `/registration/picture/${found.number}`;
  $("image").hidden = false;
  $("waiting").hidden = true;
  $("setup").disabled = false;
  $("path").value = found.path;
  note(found.note && (found.is_found ? found.note : `Register refuses: ${found.note}. You can place everything by hand.`));
  handles.begin(found.width_px, found.height_px);
  show();
}

function note(sentence) { $("note").textContent = sentence; $("note").hidden = !sentence; }

/** Correct a file instead of what was found; a step that can be undone. */
async function load() {
  try {
    const { draft } = await desk.load(opened.number, $("path").value.trim());
    put(draft, "");
    note(`Loaded: ${draft.file}. The figures compare it with what is seen in this picture.`);
  } catch (error) {
    if (!(error instanceof desk.Refused)) throw error;
    note(error.message);
  }
}

async function save(event, overwrite = false) {
  event?.preventDefault();
  const draft = history.now;
  $("save-button").disabled = true;
  try {
    const { paths } = await desk.save(opened.number, draft, $("path").value.trim(), $("picture").checked, overwrite);
    savedDraft = draft;
    verdict(`Saved: ${paths.join(" and ")}. ${starts ? "The loop starts." : "Use it with --registration."}`);
    if (starts) await go();
  } catch (error) {
    if (!(error instanceof desk.Refused)) throw error;
    if (error.exists) ask(error.message);
    else verdict(error.message, true);
  } finally {
    showButtons();
  }
}

async function go() {
  if (await desk.loopStarts()) location.assign("/");
  else verdict("The loop did not start; the terminal says why.", true);
}

function ask(sentence) {
  $("exists-title").textContent = `${sentence}.`;
  $("exists").returnValue = "";
  $("exists").showModal();
}

$("exists").addEventListener("close", () => { if ($("exists").returnValue === "overwrite") save(null, true); });
$("open").addEventListener("submit", open);
$("save").addEventListener("submit", save);
$("load").addEventListener("click", load);
$("mirrored").addEventListener("change", () => put(edits.mirrored(history.now, $("mirrored").checked), ""));
$("diameter").addEventListener("input", () => { const given = $("diameter").valueAsNumber; if (given > 0) put(edits.diameter(history.now, given), "diameter"); });
for (const step of ["undo", "redo", "again"]) $(step).addEventListener("click", () => { history[step](); show(); });
addEventListener("keydown", (event) => {
  if (!history || !(event.ctrlKey || event.metaKey) || event.target.matches("input:not([type=checkbox], [type=radio])")) return;
  const step = { z: event.shiftKey ? "redo" : "undo", Z: "redo", y: "redo" }[event.key];
  if (step) { event.preventDefault(); history[step](); show(); }
});
addEventListener("beforeunload", (event) => { if (history && history.past.length && savedDraft !== history.now) event.preventDefault(); });

desk.start().then((told) => {
  starts = told.starts;
  if (starts) $("save-button").textContent = "Save and start";
  $("source").value ||= told.source;  // unless somebody has been faster
  if (starts) open();
}).catch((error) => note(error.message));
