/** The recordings page: the run, the step and the job that it shows. */

import { $, make, showOrHide } from "../common/dom.js";
import { Events, showMeasures } from "./summary.js";
import { beginFinder } from "./finder.js";
import { Moment } from "./moment.js";
import { Player } from "./player.js";
import { Run } from "./run.js";
import { RunList, date, seconds } from "./run_list.js";
import { isAbort, messages } from "./stream.js";
import { Timeline } from "./timeline.js";

const list = new RunList();
const moment = new Moment((error) => { player.pause(); complain(error); });
const player = new Player(showStep, (isPlaying) => { $("play").textContent = isPlaying ? "❚❚ Pause" : "▶ Play"; });
const timeline = new Timeline($("timeline"), $("lanes"), (time_ms) => player.seekTime(time_ms));
const events = new Events((number) => { player.pause(); player.seek(number); });
/** The page's state; tests read it. */
export const page = { run: /** @type {RecordedRun | null} */ (null), applied: /** @type {string | null} */ (null), moment, timeline, player };
const ADDRESS_MS = 250;  // after the last change; browsers ignore addresses that change too often
/** Will write the address. */ let writing = 0;
/** Aborts the job that runs for this page. @type {AbortController | null} */ let job = null;

/** Show what the address names, #NAME?step=NUMBER&with=PROCEDURE: a run, a step, a comparison; or the list. */
async function navigate() {
  job?.abort();
  clearTimeout(writing);
  complain(null);
  const [address, query] = location.hash.slice(1).split("?"), name = decodeURIComponent(address), given = new URLSearchParams(query);
  $("list").hidden = Boolean(name);
  $("run").hidden = !name;
  page.run = player.run = null;
  player.pause();
  delete document.body.dataset.step;
  if (name) { list.stop(); await open(name); await follow(given); return; }
  document.title = "haptigraph · recordings";
  $("source").textContent = $("procedure").textContent = "";
  await list.load().catch(complain);
}

/** Show the step of an address, and compare with its procedure. @param {URLSearchParams} given */
async function follow(given) {
  const { run } = page, procedure = given.get("with");
  if (!run) return;
  if (given.has("step")) player.seek(Number(given.get("step")));
  if (procedure !== null) await compareWith(run, procedure);
}

/** Let the address name what is shown: run, step, and the procedure of a comparison. */
function keepAddress() {
  clearTimeout(writing);
  writing = setTimeout(() => {
    if (!page.run || job) return;  // a job may still show more
    const given = new URLSearchParams({ step: String(player.number), ...(page.applied === null ? {} : { with: page.applied }) });
    history.replaceState(null, "", `#${encodeURIComponent(moment.name)}?${given}`);
  }, ADDRESS_MS);
}

/** Replay the run under a procedure, and show both. @param {RecordedRun} run @param {string} procedure empty: the recorded one */
async function compareWith(run, procedure) {
  compare(run, null);
  const select = $("other"), isOffered = [...select.options].some(({ value }) => value === procedure);
  if (!isOffered) select.append(make("option", { value: procedure, textContent: procedure }));
  select.value = procedure;
  await runJob("Replaying", "compare", { name: moment.name, procedure }, (content, bytes) => {
    compare(run, new Run(content, bytes, content.state_descriptions));
    page.applied = procedure;
  });
}

async function open(/** @type {string} */ name) {
  $("name").textContent = name;
  $("about").textContent = "";
  showOrHide($("notes"), "");
  showVerdict("");
  $("run").classList.add("empty");
  if (!list.procedures.length) list.load().catch(complain).finally(() => list.stop());
  await runJob("Reading the recording", "timeline", { name }, (content, bytes) => begin(name, new Run(content, bytes, content.hello.procedure.states)));
}

function begin(/** @type {string} */ name, /** @type {RecordedRun} */ run) {
  const { run: info, notes, has_truth } = run.content;
  page.run = run;
  $("run").classList.remove("empty");
  const who = [info.participant && `participant ${info.participant}`, info.trial && `trial ${info.trial}`].filter(Boolean);
  const truth = has_truth ? [`simulated; errors: haptigraph evaluate ${name}`] : [];
  $("about").textContent = [date(info.started_utc), seconds(run.end_ms / 1000), ...who, ...truth].join(" · ");
  $("about").title = `${run.length} steps, recorded by haptigraph ${info.version}`;
  showOrHide($("notes"), notes.join("\n"));
  $("timeline").setAttribute("aria-valuemax", String(run.length - 1));
  moment.begin(name, run);
  timeline.begin(run);
  player.begin(run);
  compare(run, null);
  const options = list.procedures.map((value) => make("option", { value, textContent: value }));
  $("other").replaceChildren(make("option", { value: "", textContent: "the recorded procedure" }), ...options);
  player.seek(0);
}

/** Compare the run with itself under another procedure. @param {RecordedRun} run @param {ComparedRun | null} other null: no comparison */
function compare(run, other) {
  moment.other = other;
  page.applied = null;
  timeline.compare(other);
  showMeasures(run, other);
  events.begin(run, other, timeline.differences);
  moment.showMore();
  events.show(player.number);
  showVerdict("");
  if (!other) return;
  const { procedure, steps, identical, state_differs, haptics_differ, dropped_images, differing_images } = other.content;
  const dropped = dropped_images ? ` ${dropped_images} images were not recorded; what depends on them differs.` : "";
  const differing = differing_images ? ` ${differing_images} images have other pixels here than during the run.` : "";
  const images = dropped + differing;
  showVerdict(state_differs + haptics_differ
    ? `≠ With ${procedure} the state differs in ${state_differs} of ${steps} steps, haptics in ${haptics_differ}.${images}`
    : `✓ With ${procedure} every step has the same state and haptics; ${identical} of ${steps} are identical to the last bit.${images}`);
}

function showVerdict(/** @type {string} */ text) {
  showOrHide($("verdict"), text);
  $("help").hidden = Boolean(text);
}

function showStep(/** @type {number} */ number) {
  const { run } = page;
  if (!run) return;
  const text = `${(run.time_ms[number] / 1000).toFixed(3)} s of ${(run.end_ms / 1000).toFixed(1)} s · step ${number}`;
  $("now").textContent = text;
  $("timeline").setAttribute("aria-valuenow", String(number));
  $("timeline").setAttribute("aria-valuetext", `${text}, ${run.stateAt(number).replaceAll("_", " ")}`);
  timeline.show(number);
  events.show(number);
  moment.show(number);
  keepAddress();
}

/** Run a job on the server and show its progress.
 *  @param {string} title @param {string} name @param {Record<string, string>} parameters
 *  @param {(content: any, bytes: Uint8Array<ArrayBuffer>) => void} onMessage gets every message that is not progress */
async function runJob(title, name, parameters, onMessage) {
  job?.abort();
  const own = job = new AbortController();
  complain(null);
  $("tools").hidden = true;
  $("work").hidden = false;
  $("doing").textContent = `${title} …`;
  $("done").removeAttribute("value");
  try {
    for await (const [content, bytes] of messages(`/recordings/${name}`, parameters, own.signal)) {
      if (own.signal.aborted) return;
      if (content.type !== "progress") { onMessage(content, bytes); continue; }
      if (content.total) Object.assign($("done"), { max: content.total, value: content.done });
      $("doing").textContent = content.total ? `${title}: ${Math.round(100 * content.done / content.total)} %` : `${title}: ${content.what} …`;
    }
  } catch (error) {
    if (!isAbort(error)) complain(error);
  } finally {
    if (job === own) {
      job = null;
      $("work").hidden = true;
      $("tools").hidden = !page.run;
      keepAddress();
    }
  }
}

async function save(/** @type {"csv" | "png"} */ kind, /** @type {string} */ type) {
  const parts = /** @type {Uint8Array<ArrayBuffer>[]} */ ([]);
  const { name } = moment, procedure = (kind === "png" && page.applied) || "";
  const given = /** @type {Record<string, string>} */ (procedure ? { name, procedure } : { name }), ending = procedure && `-${procedure.replace(/\.toml$/, "")}`;
  await runJob(`Creating ${kind.toUpperCase()}`, kind, given, (content, bytes) => {
    if (content.type === "part") parts.push(bytes);
    if (content.type !== "complete") return;
    const href = URL.createObjectURL(new Blob(parts, { type })), stem = name.split("/").at(-1)?.replace(/\.mcap$/, "");
    make("a", { href, download: `${stem}${ending}.${kind}` }).click();
    setTimeout(() => URL.revokeObjectURL(href), 60_000);
  });
}

function complain(/** @type {unknown} */ error) { showOrHide($("problem"), error instanceof Error ? error.message : ""); }

$("refresh").addEventListener("click", () => list.load().catch(complain));
$("play").addEventListener("click", () => player.toggle());
$("closer").addEventListener("click", () => timeline.zoom(0.5));
$("wider").addEventListener("click", () => timeline.zoom(2));
$("whole").addEventListener("click", () => timeline.setRange(0, Infinity));
$("stop").addEventListener("click", () => job?.abort());
$("csv").addEventListener("click", () => save("csv", "text/csv"));
$("png").addEventListener("click", () => save("png", "image/png"));
$("compare").addEventListener("click", () => {
  if (page.run) compareWith(page.run, $("other").value);
});
beginFinder(complain);
addEventListener("hashchange", navigate);
navigate();
