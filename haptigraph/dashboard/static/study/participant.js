/** The participant's page: shows the one stage that comes next, and passes on what is done in it. */

import { Feed } from "../server/feed.js";
import { Refused } from "../server/ask.js";
import { Sheet } from "./sheet.js";
import { Sync } from "../server/sync.js";
import { Touch } from "../server/touch.js";
import { Trial } from "./trial.js";

const $ = (id) => document.getElementById(id);
const BUTTONS = { briefing: "Go on", consent: "I agree", break: "Go on", thanks: "Finish" };
const SCREENS = ["wait", "words", "sheet", "trial"];

const touch = new Touch(150);
const sync = new Sync("/participant", show);
/** What this page knows; tests read it. */
export const page = new Feed(touch, {
  hello(message) { trial.hello(message); },
  image(header, picture) { trial.image(header, picture); },
  controls({ holder }) { trial.held(holder); },
  you({ name }) { trial.me = name; },
  study() { sync.refresh(); },
  opened() { sync.forget(); sync.refresh(); },
  lost() { trial.held(""); complain("The connection is lost. Please wait a moment."); },
  hidden() { trial.letGo(); sheet.keep(); },
});
page.now = null;
const trial = new Trial(page, act);
const sheet = new Sheet($("sheet"), (name, content) => sync.act(name, content), act, () => sync.refresh(),
  ({ participant, key }) => page.now.participant === participant && page.now.stage?.key === key);
let shown = "";  // whose stage is on the screen
let refused = "";  // why the last act was refused

/** Do something that the participant wants; what is refused is told. */
async function act(name) {
  const { participant, stage } = page.now;
  for (const button of document.querySelectorAll("button")) button.disabled = true;
  try {
    refused = "";
    await sync.act(name, { participant, key: stage.key });
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    refused = error.message;
    complain(refused);
    sync.refresh();
  } finally {
    for (const button of document.querySelectorAll("button")) button.disabled = false;
  }
}

function complain(sentence) {
  $("problem").hidden = !sentence;
  $("problem").textContent = sentence;
}

/** Show how things are; the screen is made anew only when another stage comes. */
function show(now) {
  page.now = now;
  const trouble = now.trouble ? "Something does not work. Please tell the experimenter." : refused;
  complain(page.isOpen ? trouble : "The connection is lost. Please wait a moment.");
  $("title").textContent = document.title = now.title;
  $("simulated").hidden = !now.simulated;
  $("who").textContent = now.participant;
  $("way").hidden = !now.participant;
  if (now.participant) {
    $("progress").value = now.done / now.of;
    $("steps").textContent = `${now.done} of ${now.of}`;
  }
  const { stage } = now;
  const name = !now.participant ? "wait" : !stage || stage.text !== undefined ? "words" : stage.items ? "sheet" : "trial";
  for (const each of SCREENS) $(each).hidden = each !== name;
  document.body.dataset.screen = name;
  document.body.dataset.stage = stage?.key ?? "";
  if (name === "trial") trial.now(now);
  const place = now.participant && `${now.participant} ${stage?.key ?? now.ended} ${stage?.attempt ?? ""}`;
  if (name === "sheet" && place === shown) sheet.flush();
  if (name === "wait" || place === shown) return;
  shown = place;
  if (refused) complain(refused = "");
  if (name === "words") showWords(now);
  if (name === "sheet") sheet.begin(now.participant, stage);
  if (name === "trial") trial.begin(stage, now.doing);
  scrollTo(0, 0);
  $(name).parentElement.scrollTop = 0;
  $(`${name}-title`).focus({ preventScroll: true });
}

function showWords(now) {
  const { stage } = now, isOver = !stage;
  const text = isOver ? now.thanks : stage.text;
  $("words-title").textContent = isOver ? "Thank you" : stage.kind === "thanks" ? "Thank you" : stage.title;
  $("words-text").replaceChildren(...text.trim().split(/\n\s*\n/).map((words) => Object.assign(document.createElement("p"), { textContent: words })));
  if (stage?.kind === "consent") $("words-text").append(Object.assign(document.createElement("p"), { className: "quiet", textContent: "If you do not agree, or have a question, tell the experimenter." }));
  $("words-done").hidden = isOver;
  $("words-done").textContent = BUTTONS[stage?.kind] ?? "";
}

$("words-done").addEventListener("click", () => act("done"));
sync.refresh();
