/** The experimenter's page: who is here and how far, what the trial does, and what the experimenter does about it. */

import { NoAnswer, Refused, ask } from "../server/ask.js";
import { confirmed } from "./dialog.js";
import { Feed } from "../server/feed.js";
import { Monitor } from "./monitor.js";
import { showNotes, showPlan, showRoster } from "./study_lists.js";
import { Sync } from "../server/sync.js";
import { Touch } from "../server/touch.js";

const OTHERS_MS = 5000;
const $ = (id) => document.getElementById(id);

const touch = new Touch(150);
const sync = new Sync("/study", show);
/** What this page knows; tests read it. */
export const page = new Feed(touch, {
  hello(message) { monitor.hello(message); },
  image(header, picture) { monitor.image(header, picture); },
  touch({ edges }) { monitor.traces.touch(edges); },
  health(message) { monitor.health(message); },
  study() { sync.refresh(); },
  opened() { sync.forget(); sync.refresh(); },
  lost() { complain(); },
});
page.now = null;
const monitor = new Monitor(page);
let refused = "";  // why the last act was refused
let begun_ms = null;  // when the trial that runs began, on this page's clock

/** Do something; what is refused is told. True if it was done. */
async function act(name, content) {
  refused = "";
  try {
    await sync.act(name, content);
    return true;
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    refused = error.message;
    if (!(error instanceof NoAnswer)) sync.refresh();
    return false;
  } finally { complain(); }
}

function complain() {
  const problem = page.isOpen ? refused || page.now?.problem : "The server does not answer. If it has ended, start haptigraph study run again: it goes on where it stopped.";
  $("problem").hidden = !problem;
  $("problem").textContent = problem ?? "";
}

function show(now) {
  page.now = now;
  const { here } = now;
  $("title").textContent = $("title").title = now.title;
  document.title = `${here ? `${here.participant} · ` : ""}${now.title}`;
  $("simulated").hidden = !now.simulated;
  $("station").textContent = `· station ${now.station}`;
  begun_ms = now.elapsed_s === null ? null : performance.now() - now.elapsed_s * 1000;
  showRoster(now, open);
  showPlan(here);
  showNotes(here);
  showStage(now);
  monitor.now(now);
  complain();
  document.body.dataset.doing = now.doing;
  document.body.dataset.stage = here?.stage?.key ?? "";
}

function showStage({ here, doing, participants, station }) {
  const stage = here?.stage;
  const mine = participants.find((each) => each.station === station);
  $("participant").textContent = here?.participant ?? "";
  say($("stage"), stage ? [stage.title, stage.condition].filter(Boolean).join(" · ") : here ? here.ended : mine ? `${mine.participant} was here when the station stopped` : "Nobody is here");
  const facts = here && [`stage ${Math.min(here.done + 1, here.of)} of ${here.of}`, stage && about(stage, doing), here.is_felt ? "" : "without touch"];
  $("detail").textContent = here ? facts.filter(Boolean).join(" · ")
    : mine ? "Resume on the left goes on exactly there; a trial that was cut off is done again." : "Take someone in, or bring one here from the list.";
  $("begin").hidden = !(stage?.timeout_s && !doing);
  $("finish").hidden = !["break", "thanks"].includes(stage?.kind);
  $("abort").hidden = !doing;
  $("abort").disabled = doing !== "running";
  $("repeat").hidden = !here?.repeatable || Boolean(doing);
  $("stop").hidden = !stage || Boolean(doing);
  $("withdraw").hidden = $("leave").hidden = !here || Boolean(doing);
}

function about(stage, doing) {
  if (stage.asked) return `${stage.answered} of ${stage.asked} answered`;
  if (!stage.timeout_s) return "";
  const attempt = stage.attempt > 1 ? `attempt ${stage.attempt}, ` : "";
  return attempt + ({ "": "waits for the participant to begin", preparing: "is being prepared", running: "runs", ending: "is being kept" }[doing]);
}

async function open(participant, elsewhere) {
  const { here } = page.now;
  const leaves = here && here.stage && here.done > 0 ? `${here.participant} leaves, and may come back. ` : "";
  if (elsewhere || leaves) {
    const sure = await confirmed({
      question: `Bring ${participant} to this station?`, sure: elsewhere ? "Take over" : "Bring here",
      consequence: leaves + (elsewhere ? `${participant} is at station ${elsewhere}, which is cut off; a trial that runs there is interrupted.` : ""),
    });
    if (sure === null) return;
  }
  await act("open", { participant, take_over: Boolean(elsewhere) });
}

/** Let a button do something about the participant who is here, after a question. */
function asking(id, name, words, content) {
  $(id).addEventListener("click", async () => {
    const { here } = page.now;
    const reason = await confirmed(words(here));
    if (reason !== null) await act(name, content(here, reason));
  });
}

asking("abort", "abort", () => ({ question: "Abort this trial?", consequence: "It does not count, and is begun again unless that was the last attempt.", sure: "Abort", reason: true }),
  (here, reason) => ({ participant: here.participant, key: here.stage.key, reason }));
asking("repeat", "repeat", (here) => ({ question: `Do ${here.plan[here.done - 1].title} again?`, consequence: "What was done stays in the data, but does not count.", sure: "Repeat", reason: true }),
  (here, reason) => ({ participant: here.participant, key: here.repeatable, reason }));
asking("stop", "stop", (here) => ({ question: `End the session of ${here.participant} for good?`, consequence: "What was done counts. Nothing more is asked; this cannot be undone.", sure: "End session", reason: true }),
  (here, text) => ({ participant: here.participant, text }));
asking("withdraw", "withdraw", (here) => ({ question: `Has ${here.participant} left the study?`, consequence: "What was done stays, and another participant gets the place. This cannot be undone.", sure: "Has left" }),
  (here) => ({ participant: here.participant }));

$("leave").addEventListener("click", () => act("leave", { participant: page.now.here.participant }));
$("enrol").addEventListener("submit", async (event) => {
  event.preventDefault();
  if (await act("enrol", { participant: $("pseudonym").value })) $("pseudonym").value = "";
});
$("note").addEventListener("submit", async (event) => {
  event.preventDefault();
  if (await act("note", { participant: page.now.here.participant, text: $("text").value })) $("text").value = "";
});
$("text").addEventListener("keydown", (event) => {
  if (event.key === "Enter" && !event.shiftKey) { event.preventDefault(); $("note").requestSubmit(); }
});
for (const [id, name] of [["begin", "begin"], ["finish", "done"]]) $(id).addEventListener("click", () => forParticipant(name));

/** Do what the participant's page does. */
async function forParticipant(name) {
  const { participant, stage } = page.now.here;
  try { await ask(`/participant/${name}`, { participant, key: stage.key }); refused = ""; } catch (error) { refused = error.message; }
  complain();
  sync.refresh();
}

function say(element, text) { if (element.textContent !== text) element.textContent = text; }

setInterval(() => {
  const limit = page.now?.here?.stage?.timeout_s;
  const elapsed_s = begun_ms === null ? null : Math.floor((performance.now() - begun_ms) / 1000);
  say($("clock"), elapsed_s === null ? "" : `${minutes(elapsed_s)} of ${minutes(limit)}`);
}, 250);
setInterval(() => { if (page.isOpen && !page.now?.doing && !document.hidden) sync.refresh(); }, OTHERS_MS);

function minutes(seconds) { return `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`; }
