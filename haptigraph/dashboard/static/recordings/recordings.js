/** The page of recordings: which run, which moment, which work is being done. */

import { Events, showMeasures } from "./facts.js";
import { frames } from "./frames.js";
import { Moment } from "./moment.js";
import { Player } from "./player.js";
import { Run } from "./run.js";
import { RunList, date, seconds } from "./runlist.js";
import { Timeline } from "./timeline.js";

const $ = (id) => document.getElementById(id);

const list = new RunList();
const moment = new Moment((error) => { player.pause(); complain(error); });
const player = new Player(showStep, (isPlaying) => { $("play").textContent = isPlaying ? "❚❚ Pause" : "▶ Play"; });
const timeline = new Timeline($("timeline"), $("lanes"), (time_ms) => player.seekTime(time_ms));
const events = new Events((number) => { player.pause(); player.seek(number); });
/** What this page knows; tests read it. */
export const page = { run: null, other: null, moment, timeline, player };
let work = null;  // ends what the server is doing for this page

/** Show the run that the address names, or the list. */
async function turn() {
  work?.abort();
  complain(null);
  const name = decodeURIComponent(location.hash.slice(1));
  $("list").hidden = Boolean(name);
  $("run").hidden = !name;
  page.run = page.other = player.run = null;
  player.pause();
  delete document.body.dataset.step;
  if (name) { list.stop(); await open(name); return; }
  document.title = "haptigraph · recordings";
  $("source").textContent = $("procedure").textContent = "";
  await list.load().catch(complain);
}

async function open(name) {
  $("name").textContent = name;
  for (const part of ["about", "verdict", "notes"]) $(part).textContent = "";
  $("notes").hidden = true;
  verdict("");
  $("run").classList.add("empty");
  if (!list.procedures.length) list.load().catch(complain).finally(() => list.stop());
  await doing("Reading the recording", "timeline", { name }, (content, bytes) => { begin(name, new Run(content, bytes)); });
}

function begin(name, run) {
  const { run: info, notes } = run.content;
  page.run = run;
  $("run").classList.remove("empty");
  const who = [info.participant && `participant ${info.participant}`, info.trial && `trial ${info.trial}`].filter(Boolean);
  $("about").textContent = [date(info.started_utc), seconds(run.end_ms / 1000), ...who].join(" · ");
  $("about").title = `${run.length} steps, recorded by haptigraph ${info.version}`;
  $("notes").hidden = !notes.length;
  $("notes").textContent = notes.join("\n");
  $("timeline").setAttribute("aria-valuemax", run.length - 1);
  moment.begin(name, run);
  timeline.begin(run);
  player.begin(run);
  lay(null);
  offer(list.procedures);
  player.seek(0);
}

/** Lay what another procedure makes of the run beside it; null: nothing. */
function lay(other) {
  page.other = moment.other = other;
  timeline.compare(other);
  showMeasures(page.run, other);
  events.begin(page.run, other, timeline.differences);
  moment.showMore();
  events.show(player.number);
  verdict("");
  if (!other) return;
  const { procedure, steps, identical, state_differs, touch_differs, dropped_images } = other.content;
  const dropped = dropped_images ? ` ${dropped_images} images were not recorded; what depends on them differs.` : "";
  verdict(state_differs + touch_differs
    ? `≠ Under ${procedure} the state differs in ${state_differs} of ${steps} steps, the touch in ${touch_differs}.${dropped}`
    : `✓ Under ${procedure} every step has the same state and touch; ${identical} of ${steps} are identical to the last bit.${dropped}`);
}

function verdict(words) {
  $("verdict").textContent = words;
  $("verdict").hidden = !words;
  $("help").hidden = Boolean(words);
}

function offer(procedures) {
  const own = page.run.content.hello.procedure.name;
  const options = procedures.map((value) => Object.assign(document.createElement("option"), { value, textContent: value }));
  options.unshift(Object.assign(document.createElement("option"), { value: "", textContent: `${own}, as recorded` }));
  $("other").replaceChildren(...options);
}

function showStep(number) {
  const { run } = page, time_s = (run.time_ms[number] / 1000).toFixed(3);
  const words = `${time_s} s of ${(run.end_ms / 1000).toFixed(1)} s · step ${number} of ${run.length - 1}`;
  $("now").textContent = words;
  $("timeline").setAttribute("aria-valuenow", number);
  $("timeline").setAttribute("aria-valuetext", `${words}, ${run.stateAt(number).replaceAll("_", " ")}`);
  timeline.show(number);
  events.show(number);
  moment.show(number);
}

/** Let the server work, and show how far it is; `take` gets every frame that is not progress. */
async function doing(words, job, parameters, take) {
  work?.abort();
  const own = work = new AbortController();
  complain(null);
  $("tools").hidden = true;
  $("work").hidden = false;
  $("doing").textContent = `${words} …`;
  $("done").removeAttribute("value");
  try {
    for await (const [content, bytes] of frames(`/recordings/${job}`, parameters, own.signal)) {
      if (own.signal.aborted) return;
      if (content.type !== "progress") { take(content, bytes); continue; }
      if (content.total) Object.assign($("done"), { max: content.total, value: content.done });
      $("doing").textContent = content.total ? `${words}: ${Math.round(100 * content.done / content.total)} %` : `${words}: ${content.what} …`;
    }
  } catch (error) {
    if (error.name !== "AbortError") complain(error);
  } finally {
    if (work === own) {
      work = null;
      $("work").hidden = true;
      $("tools").hidden = !page.run;
    }
  }
}

async function save(kind, type) {
  const parts = [], { name } = moment;
  await doing(`Making ${kind.toUpperCase()}`, kind, { name }, (content, bytes) => {
    if (content.type === "part") parts.push(bytes);
    if (content.type !== "whole") return;
    const link = Object.assign(document.createElement("a"), {
      href: URL.createObjectURL(new Blob(parts, { type })), download: `${name.split("/").at(-1).replace(/\.mcap$/, "")}.${kind}`,
    });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
  });
}

function complain(error) {
  $("problem").hidden = !error;
  $("problem").textContent = error?.message ?? "";
}

$("again").addEventListener("click", () => list.load().catch(complain));
$("play").addEventListener("click", () => player.toggle());
$("closer").addEventListener("click", () => timeline.zoom(0.5));
$("wider").addEventListener("click", () => timeline.zoom(2));
$("whole").addEventListener("click", () => timeline.look(0, Infinity));
$("stop").addEventListener("click", () => work?.abort());
$("csv").addEventListener("click", () => save("csv", "text/csv"));
$("png").addEventListener("click", () => save("png", "image/png"));
$("compare").addEventListener("click", () => {
  const procedure = $("other").value;
  lay(null);
  doing("Replaying", "compare", { name: moment.name, procedure }, (content, bytes) => lay(new Run(content, bytes)));
});
addEventListener("hashchange", turn);
turn();
