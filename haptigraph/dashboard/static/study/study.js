/** The experimenter's page: the current session, its trial, and the experimenter's actions. */

import { $, setText, showOrHide } from "../common/dom.js";
import { confirmed } from "./dialog.js";
import { Feed } from "../common/feed.js";
import { Haptics } from "../common/haptics.js";
import { showNotes, showPlan, showRoster } from "./lists.js";
import { Monitor } from "./monitor.js";
import { NoResponse, RequestError, request } from "../common/request.js";
import { Sync } from "../common/sync.js";

const REFRESH_MS = 5000;  // other stations change the study too

const haptics = new Haptics(150);
/** @type {Sync<ExperimenterStatus>} */ const sync = new Sync("/study", show);
const feed = new Feed(haptics, {
  hello(hello) { monitor.begin(hello); },
  image(header, picture) { monitor.show(header, picture); },
  haptics({ edges }) { monitor.traces.addEdges(edges); },
  health(health) { monitor.showHealth(health); },
  study() { sync.refresh(); },
  opened() { sync.reset(); sync.refresh(); },
  lost() { complain(); },
});
/** The page's state; tests read it. */
export const page = Object.assign(feed, { status: /** @type {ExperimenterStatus | null} */ (null) });
const monitor = new Monitor(page);
let refused = "";  // why the last action was refused
/** When the trial that runs began, on this page's clock. @type {number | null} */ let started_ms = null;

/** Send an action; show why it is refused, return whether it succeeded. @param {string} name @param {object} body */
async function act(name, body) {
  refused = "";
  try {
    await sync.act(name, body);
    return true;
  } catch (error) {
    if (!(error instanceof RequestError)) throw error;
    refused = error.message;
    if (!(error instanceof NoResponse)) sync.refresh();
    return false;
  } finally { complain(); }
}

function complain() {
  const problem = page.isOpen ? refused || page.status?.problem || touchProblem(page.status) || page.status?.remark : "The server does not respond. If it has stopped, start haptigraph study run again; it continues where it stopped.";
  showOrHide($("problem"), problem ?? "");
}

/** Say why the trial that comes next must not begin. @param {ExperimenterStatus | null} status */
function touchProblem(status) { return status?.trial_status ? "" : status?.current?.touch.problem; }

function show(/** @type {ExperimenterStatus} */ status) {
  const { current } = page.status = status;
  $("title").textContent = $("title").title = status.title;
  document.title = `${current ? `${current.participant} · ` : ""}${status.title}`;
  $("simulated").hidden = !status.simulated;
  $("station").textContent = `· station ${status.station}`;
  started_ms = status.elapsed_s === null ? null : performance.now() - status.elapsed_s * 1000;
  showRoster(status, open);
  showPlan(current);
  showNotes(current);
  showStage(status);
  monitor.showStatus(status);
  complain();
  document.body.dataset.trial = status.trial_status;
  document.body.dataset.stage = current?.stage?.key ?? "";
}

function showStage(/** @type {ExperimenterStatus} */ { current, trial_status, participants, station }) {
  const stage = current?.stage;
  const interrupted = participants.find((each) => each.station === station);
  $("participant").textContent = current?.participant ?? "";
  if (current) {
    setText($("stage"), stage ? [stage.title, stage.condition].filter(Boolean).join(" · ") : current.ended);
    const facts = [`stage ${Math.min(current.done + 1, current.total)} of ${current.total}`, stage && stageText(stage, trial_status), stage?.timeout_s && current.touch.output && `haptic output ${current.touch.output}`, !current.has_haptics && "without haptic feedback"];
    $("detail").textContent = facts.filter(Boolean).join(" · ");
  } else {
    setText($("stage"), interrupted ? `${interrupted.participant} was here when the station stopped` : "No participant at this station");
    $("detail").textContent = interrupted ? "Resume, on the left, continues there; an interrupted trial is repeated." : "Enrol a participant, or open one from the list.";
  }
  $("enrol-button").classList.toggle("primary", !current);
  $("begin").hidden = !(stage?.timeout_s && !trial_status);
  $("begin").disabled = Boolean(current?.touch.problem);
  $("finish").hidden = stage?.kind !== "break" && stage?.kind !== "thanks";
  $("abort").hidden = !trial_status || trial_status === "stimulus";
  $("abort").disabled = trial_status !== "running";
  $("repeat").hidden = !current?.repeatable || Boolean(trial_status);
  $("skip").hidden = stage?.kind !== "calibration" || Boolean(trial_status);
  showOrHide($("calibration-result"), current?.calibration ? `Calibration: ${current.calibration}.` : "");
  $("stop").hidden = !stage || Boolean(trial_status);
  $("withdraw").hidden = $("leave").hidden = !current || Boolean(trial_status);
  $("unenrol").hidden = !current?.may_undo_enrolment || Boolean(trial_status);
}

function stageText(/** @type {StageSummary} */ stage, /** @type {TrialStatus} */ status) {
  if (stage.item_count) return `${stage.answer_count} of ${stage.item_count} answered`;
  if (!stage.timeout_s) return "";
  const attempt = stage.attempt > 1 ? `attempt ${stage.attempt}, ` : "";
  return attempt + { "": "waiting for the participant to begin", preparing: "preparing", running: "running", ending: "saving", stimulus: "a vibration is played" }[status];
}

/** Say who leaves this station when another comes; empty if nobody is in the middle of a session. @param {CurrentSession | null | undefined} current */
function leaving(current) {
  return current?.stage && current.done > 0 ? `${current.participant} leaves this station and may come back. ` : "";
}

/** Say who has a place at this station without having consented; empty if nobody has. @param {ExperimenterStatus | null} status */
function waiting(status) {
  const names = (status?.participants ?? []).filter((each) => !each.has_consented && !each.has_left && (!each.station || each.station === status?.station))
    .map((each) => each.participant);
  return names.length ? `Enrolled but without consent: ${names.join(", ")}. To free a place, cancel and press Undo enrolment. ` : "";
}

/** Open a participant at this station. @param {string} participant @param {string} otherStation that has the participant; empty: none */
async function open(participant, otherStation) {
  const current = page.status?.current;
  const leaves = leaving(current);
  const views = page.status?.participants.some((each) => each.participant === participant && each.ended)
    ? `The plan and the notes of ${participant} are shown here. ${participant} is at this station until you press Leave station. ` : "";
  if (otherStation || leaves || views) {
    const reason = await confirmed({
      question: `Open ${participant} at this station?`, confirm: otherStation ? "Take over" : "Open",
      consequence: leaves + views + (otherStation ? `${participant} is at station ${otherStation}, which is cut off; a trial that runs there is interrupted.` : ""),
    });
    if (reason === null) return;
  }
  await act("open", { participant, take_over: Boolean(otherStation) });
}

/** Let a button do something with the current session, after a confirmation.
 *  @param {"abort" | "repeat" | "skip" | "stop" | "withdraw" | "unenrol"} name of the button and of the action
 *  @param {(current: CurrentSession) => Parameters<typeof confirmed>[0]} texts @param {(current: CurrentSession, reason: string) => object} body */
function confirmFirst(name, texts, body) {
  $(name).addEventListener("click", async () => {
    const current = page.status?.current;
    const reason = current ? await confirmed(texts(current)) : null;
    if (current && reason !== null) await act(name, { participant: current.participant, ...body(current, reason) });
  });
}

confirmFirst("abort", () => ({ question: "Abort this trial?", consequence: "It does not count, and is repeated unless this was the last attempt.", confirm: "Abort", needsReason: true }),
  ({ stage }, reason) => ({ key: stage?.key, reason }));
confirmFirst("repeat", (current) => ({ question: `Repeat ${current.plan[current.done - 1].title}?`, consequence: "The attempt stays in the data but does not count.", confirm: "Repeat", needsReason: true }),
  ({ repeatable }, reason) => ({ key: repeatable, reason }));
confirmFirst("skip", () => ({ question: "Skip this calibration?", consequence: "The answers so far stay; trials use the amplitudes of the procedure.", confirm: "Skip", needsReason: true }),
  ({ stage }, reason) => ({ key: stage?.key, reason }));
confirmFirst("stop", (current) => ({ question: `End the session of ${current.participant} for good?`, consequence: "Completed stages count, and no others follow. This cannot be undone.", confirm: "End session", needsReason: true }),
  (_, text) => ({ text }));
confirmFirst("withdraw", (current) => ({ question: `Has ${current.participant} left the study?`, consequence: "The data stay, and another participant gets the place. This cannot be undone.", confirm: "Withdraw" }),
  () => ({}));

confirmFirst("unenrol", (current) => ({ question: `Undo the enrolment of ${current.participant}?`, consequence: "The place and the pseudonym are free again; nothing of this participant is kept.", confirm: "Undo enrolment" }),
  () => ({}));

$("leave").addEventListener("click", () => act("leave", { participant: page.status?.current?.participant }));
$("enrol").addEventListener("submit", async (event) => {
  event.preventDefault();
  const consequence = waiting(page.status) + leaving(page.status?.current);
  if (consequence && await confirmed({ question: "Enrol another participant at this station?", consequence, confirm: "Enrol" }) === null) return;
  $("enrol-button").disabled = true;
  if (await act("enrol", { participant: $("pseudonym").value, is_confirmed: Boolean(consequence) })) $("pseudonym").value = "";
  $("enrol-button").disabled = false;
});
$("note-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  if (await act("note", { participant: page.status?.current?.participant, text: $("note-text").value })) $("note-text").value = "";
});
$("note-text").addEventListener("keydown", (event) => {
  if (event.key === "Enter" && !event.shiftKey) { event.preventDefault(); $("note-form").requestSubmit(); }
});
$("begin").addEventListener("click", () => actAsParticipant("begin"));
$("finish").addEventListener("click", () => actAsParticipant("done"));

/** Do what the participant's page does. @param {string} name */
async function actAsParticipant(name) {
  const { participant, stage } = page.status?.current ?? {};
  try {
    await request(`/participant/${name}`, { participant, key: stage?.key });
    refused = "";
  } catch (error) {
    if (!(error instanceof RequestError)) throw error;
    refused = error.message;
  }
  complain();
  sync.refresh();
}

setInterval(() => {
  const limit_s = page.status?.current?.stage?.timeout_s ?? 0;
  setText($("clock"), started_ms === null ? "" : `${minutes((performance.now() - started_ms) / 1000)} of ${minutes(limit_s)}`);
}, 250);
setInterval(() => { if (page.isOpen && !page.status?.trial_status && !document.hidden) sync.refresh(); }, REFRESH_MS);

function minutes(/** @type {number} */ seconds) { return `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`; }
