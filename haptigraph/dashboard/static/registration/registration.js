/** The registration page: opens a source, applies drags to the draft, shows the server's check of it, saves. */

import { Checker, call, loopStarts } from "./service.js";
import { $, make, showOrHide } from "../common/dom.js";
import { History, edits } from "./draft.js";
import { Handles } from "./handles.js";
import { showHint } from "../common/hint.js";
import { Loupe } from "./loupe.js";
import { RequestError } from "../common/request.js";
import { Search } from "./search.js";
import { Trocars } from "./trocars.js";

const HINT = "Choose a source, and press “Find the eye”. Then check every line over the picture: drag what is wrong, or press Tab until its handle has a ring and use the arrow keys. Save when the sentence at the end of the page says that the registration is valid.";

/** How to look at a source of which nothing is known. */
const NEW = { mirrored: true, diameter_mm: 24 };

/** The source, as the server opened it, and its drafts. @type {{ opened: OpenedSource, history: History } | null} */
let session = null;
/** The server's newest answer, and the draft it is about. @type {CheckedDraft & { draft: Draft } | null} */
let checked = null;
/** @type {Draft | null} */ let savedDraft = null;
let startsLoop = false;
let snapsTarget = false;  // as soon as the server has answered where to
/** @type {Vec[]} */ let outline_px = [];

const search = new Search(begin, showNote);
const loupe = new Loupe($("loupe"), $("image"), $("overlay"));
const handles = new Handles($("overlay"), move);
handles.onMagnify = (at) => { if (session) loupe.show(at, session.history.present, outline_px); };
handles.onDrop = ({ kind }) => {
  snapsTarget = kind === "target";
  if (session && checked?.draft === session.history.present) snap(session.history, checked);
  session?.history.endEdit();
};
handles.onConfirm = ({ kind }) => edit((draft) => edits.confirm(draft, kind));
handles.onRemove = ({ kind, index }) => { if (kind === "trocar") removeTrocar(index); };
const trocars = new Trocars($("trocars"), $("add"), {
  used: (index) => edit((draft) => edits.used(draft, index)),
  rename: (index, name) => edit((draft) => edits.rename(draft, index, name), `rename ${index}`),
  remove: removeTrocar,
  add() {
    edit((draft) => edits.addTrocar(draft, outline_px));
    if (session) handles.focus(`trocar ${session.history.present.trocars.length - 1}`);
  },
});

const checker = new Checker((answer, draft) => {
  if (!session) return;
  const { history } = session;
  checked = { ...answer, draft };
  if (draft === history.present) {
    outline_px = answer.outline_px;
    if (snapsTarget && !handles.dragged) { snap(history, checked); return; }
  }
  handles.show(history.present, outline_px);
  showChecked(checked);
}, (sentence) => { checked = null; showVerdict(sentence, true); showButtons(); });

/** Move a target that was dropped near the retina onto it, as a part of the drag. @param {History} history @param {CheckedDraft} answer */
function snap(history, { target_on_retina_px }) {
  if (snapsTarget && target_on_retina_px) history.present = { ...history.present, target_px: target_on_retina_px };
  snapsTarget = false;
  show();
}

function move(/** @type {Handle} */ { kind, index, at }, /** @type {Vec} */ step, /** @type {string} */ how) {
  const together = $("together").checked;
  edit((draft) => {
    if (kind === "radius") {
      const factor = scaleOf(draft.center_px, at, step), [cx, cy] = draft.center_px;
      outline_px = outline_px.map(([x, y]) => [cx + (x - cx) * factor, cy + (y - cy) * factor]);
      return edits.radius(draft, factor, together);
    }
    if (kind === "center") {
      outline_px = outline_px.map(([x, y]) => [x + step[0], y + step[1]]);
      return edits.center(draft, step, together);
    }
    return kind === "target" ? edits.target(draft, step) : edits[kind](draft, index, step);
  }, `${kind} ${index} ${how}`);
}

function removeTrocar(/** @type {number} */ index) {
  edit((draft) => (draft.trocars.length > 1 ? edits.removeTrocar(draft, index) : draft));
}

/** Return the factor by which the globe grows when its edge moves by a step. @param {Vec} center @param {Vec} at @param {Vec} step */
function scaleOf([cx, cy], [x, y], [dx, dy]) {
  const before = Math.hypot(x - cx, y - cy);
  const along = ((x - cx) * dx + (y - cy) * dy) / before;
  return Math.max(before + along, 5) / before;
}

/** @param {(draft: Draft) => Draft} change @param {string} [what] for edits that are undone together */
function edit(change, what = "") {
  if (!session) return;
  const { history } = session, draft = change(history.present);
  if (draft === history.present) return;
  history.put(draft, what);
  show();
}

/** Show the present draft, and request its check. */
function show() {
  if (!session) return;
  const draft = session.history.present;
  handles.show(draft, outline_px);
  trocars.show(draft);
  if (document.activeElement !== $("diameter")) $("diameter").value = String(draft.diameter_mm);
  $("mirrored").checked = draft.mirrored;
  checker.check(session.opened.number, draft);
  showButtons();
}

function showButtons() {
  const history = session?.history;
  $("undo").disabled = !history?.past.length;
  $("redo").disabled = !history?.future.length;
  $("restore").disabled = !history || history.present === history.detected;
  $("load").disabled = !history;
  $("save-button").disabled = !checked || checked.draft !== history?.present || Boolean(checked.problem);
}

function showChecked(/** @type {CheckedDraft & { draft: Draft }} */ { rows, problem, draft, mm_per_px }) {
  $("rows").replaceChildren(...rows.flatMap(tableRows));
  if (problem) showVerdict(problem, true);
  else if (savedDraft !== draft) showVerdict(`Valid registration: ${mm_per_px.toFixed(5)} mm/px.${draft.assumed.includes("target") ? " The target is assumed: click it if it is right, or drag it." : ""}`);
  showButtons();
}

function tableRows(/** @type {DraftRow} */ { what, where, off_px, off_mm, note, is_plausible }) {
  const kind = what.split(" ")[0].toLowerCase(), mark = ["globe", "retina", "target", "trocar"].includes(kind) && make("i");
  if (mark) mark.style.setProperty("--own", `var(--${kind})`);
  const texts = make("td", { colSpan: 3, textContent: [where, note].filter(Boolean).join("; ") });
  return [
    make("tr", {}, make("td", {}, mark, what), make("td", {}, off_px?.toFixed(2)), make("td", {}, off_mm?.toFixed(3))),
    make("tr", { className: is_plausible ? "texts" : "texts bad" }, texts),
  ];
}

function showVerdict(/** @type {string} */ sentence, isBad = false) {
  $("verdict").textContent = sentence;
  $("verdict").classList.toggle("bad", isBad);
}

function begin(/** @type {OpenedSource} */ opened) {
  session = { opened, history: new History(opened.draft) };
  savedDraft = checked = null; outline_px = [];
  $("image").src = `/registration/picture/${opened.number}`;
  $("image").hidden = false;
  $("anatomy").disabled = false;
  $("path").value = opened.path;
  showNote(opened.note && (opened.is_found ? opened.note : `Automatic registration failed: ${opened.note}. You can place everything by hand.`));
  handles.begin(opened.width_px, opened.height_px);
  show();
}

function showNote(/** @type {string} */ sentence) { showOrHide($("note"), sentence); }

/** Return an error that the server answered with; throw any other. @param {unknown} error */
function refusal(error) {
  if (!(error instanceof RequestError)) throw error;
  return error;
}

/** Correct a file instead of the detected draft; can be undone. */
async function load() {
  if (!session) return;
  try {
    const { draft } = await call("load", { number: session.opened.number, path: $("path").value.trim() });
    edit(() => draft);
    showNote(`Loaded ${draft.file}. The table compares it with this picture.`);
  } catch (error) {
    showNote(refusal(error).message);
  }
}

async function save(/** @type {Event | null} */ event, overwrite = false) {
  event?.preventDefault();
  if (!session) return;
  const draft = session.history.present;
  $("save-button").disabled = true;
  try {
    const { paths, exists } = await call("save", { number: session.opened.number, draft, path: $("path").value.trim(), picture: $("picture").checked, overwrite });
    if (exists) {
      $("exists-title").textContent = `${exists}.`;
      $("exists").returnValue = "";
      $("exists").showModal();
      return;
    }
    savedDraft = draft;
    showVerdict(`Saved: ${paths.join(" and ")}. ${startsLoop ? "Starting the loop." : "Use it with --registration."}`);
    if (!startsLoop) return;
    if (await loopStarts()) location.assign("/");
    else showVerdict("The loop did not start; see the terminal.", true);
  } catch (error) {
    showVerdict(refusal(error).message, true);
  } finally {
    showButtons();
  }
}

function travel(/** @type {"undo" | "redo" | "restore"} */ step) { session?.history[step](); show(); }

$("exists").addEventListener("close", () => { if ($("exists").returnValue === "overwrite") save(null, true); });
$("open").addEventListener("submit", (event) => {
  event.preventDefault();
  const { mirrored, diameter_mm } = session?.history.present ?? NEW;
  search.find({ source: $("source-input").value.trim(), mirrored, diameter_mm });
});
$("save").addEventListener("submit", save);
$("load").addEventListener("click", load);
$("mirrored").addEventListener("change", () => edit((draft) => edits.mirrored(draft, $("mirrored").checked)));
$("diameter").addEventListener("input", () => { const value = $("diameter").valueAsNumber; if (value > 0) edit((draft) => edits.diameter(draft, value), "diameter"); });
for (const step of /** @type {const} */ (["undo", "redo", "restore"])) $(step).addEventListener("click", () => travel(step));
addEventListener("keydown", (event) => {
  if (!session || !(event.ctrlKey || event.metaKey) || (event.target instanceof Element && event.target.matches("input:not([type=checkbox], [type=radio])"))) return;
  const step = event.key === "z" && !event.shiftKey ? "undo" : ["z", "Z", "y"].includes(event.key) ? "redo" : null;
  if (step) { event.preventDefault(); travel(step); }
});
addEventListener("beforeunload", (event) => { if (session?.history.past.length && savedDraft !== session.history.present) event.preventDefault(); });

showHint("registration", HINT);
call("start").then(async ({ source, starts_loop }) => {
  const { stored } = search;
  startsLoop = starts_loop;
  if (startsLoop) $("save-button").textContent = "Save and start";
  const input = $("source-input");
  if (document.activeElement !== input) input.value ||= stored?.source ?? source;  // else the user types one
  if (stored && await search.find(stored, true)) return;
  if (startsLoop) await search.find({ source, ...NEW });
}).catch((error) => showNote(error.message));
