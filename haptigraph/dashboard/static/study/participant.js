/** The participant's page: shows the next stage, and sends what the participant does in it. */

import { Calibration } from "./calibration.js";
import { $, make, showOrHide } from "../common/dom.js";
import { Feed } from "../common/feed.js";
import { Haptics } from "../common/haptics.js";
import { Questionnaire } from "./questionnaire.js";
import { RequestError } from "../common/request.js";
import { Sync } from "../common/sync.js";
import { Trial } from "./trial.js";

/** @type {Record<string, string>} */
const BUTTONS = { briefing: "Continue", consent: "I agree", break: "Continue", thanks: "Finish" };
const SCREENS = /** @type {const} */ (["wait", "text", "questionnaire", "calibration", "trial"]);
const LOST = "The connection is lost. Please wait a moment.";

const haptics = new Haptics(150);
/** @type {Sync<ParticipantStatus>} */ const sync = new Sync("/participant", show);
const feed = new Feed(haptics, {
  hello(hello) { trial.beginRun(hello); },
  image(header, picture) { trial.show(header, picture); },
  controls({ holder }) { trial.setHolder(holder); },
  welcome({ name }) { trial.me = name; },
  study() { sync.refresh(); },
  opened() { trial.touch.reset(); sync.reset(); sync.refresh(); },
  lost() { trial.setHolder(""); complain(LOST); },
  hidden() { trial.release(); questionnaire.commit(); },
}, "/participant/live");
/** The page's state; tests read it. */
export const page = Object.assign(feed, { status: /** @type {ParticipantStatus | null} */ (null) });
const trial = new Trial(page, act);
const calibration = new Calibration(act);
const questionnaire = new Questionnaire($("questionnaire"), (content) => sync.act("answer", content), () => { act("done"); }, () => sync.refresh(),
  ({ participant, key }) => page.status?.participant === participant && page.status.stage?.key === key);
let shown = "";  // the stage on the screen, and whose
let refused = "";  // why the last action was refused

/** Send an action of the participant; show why it is refused, return whether it succeeded. @param {string} name @param {object} [more] */
async function act(name, more = {}) {
  const { participant, stage } = page.status ?? {};
  for (const button of document.querySelectorAll("button")) button.disabled = true;
  try {
    refused = "";
    await sync.act(name, { participant, key: stage?.key, ...more });
    return true;
  } catch (error) {
    if (!(error instanceof RequestError)) throw error;
    refused = error.message;
    complain(refused);
    sync.refresh();
    return false;
  } finally {
    for (const button of document.querySelectorAll("button")) button.disabled = false;
    trial.touch.update();
    calibration.takeFocus();
  }
}

function complain(/** @type {string} */ sentence) { showOrHide($("problem"), sentence); }

/** Show the status; the screen is rebuilt only when another stage comes. @param {ParticipantStatus} status */
function show(status) {
  const { participant, stage } = page.status = status;
  complain(!page.isOpen ? LOST : status.has_problem ? "Something went wrong. Please tell the experimenter." : refused);
  $("title").textContent = document.title = status.title;
  $("simulated").hidden = !status.simulated;
  $("who").textContent = participant;
  $("way").hidden = !participant;
  if (participant) {
    $("progress").value = status.done / status.total;
    $("steps").textContent = `${status.done} of ${status.total}`;
  }
  const screen = !participant ? "wait" : !stage || "text" in stage ? "text" : "items" in stage ? "questionnaire" : "choices" in stage ? "calibration" : "trial";
  for (const each of SCREENS) $(each).hidden = each !== screen;
  document.body.dataset.screen = screen;
  document.body.dataset.stage = stage?.key ?? "";
  if (screen === "trial" && stage) trial.showStatus(status.trial_status, stage, status.touch);
  if (stage && "choices" in stage) calibration.show(stage, status.trial_status);
  const place = participant && `${participant} ${stage?.key ?? status.ended} ${stage?.attempt ?? ""}`;
  if (screen === "questionnaire" && place === shown) questionnaire.flush();
  if (screen === "wait" || place === shown) return;
  shown = place;
  if (refused) complain(refused = "");
  if (!stage || "text" in stage) showText(status, stage);
  else if ("items" in stage) questionnaire.begin(participant, stage);
  else if ("choices" in stage) calibration.begin(stage);
  else trial.begin(stage, status.trial_status);
  scrollTo(0, 0);
  /** @type {HTMLElement} */ ($(screen).parentElement).scrollTop = 0;
  $(`${screen}-title`).focus({ preventScroll: true });
}

/** @param {ParticipantStatus} status @param {TextStage | undefined} stage undefined: all is over */
function showText(status, stage) {
  const paragraphs = (stage?.text ?? status.thanks).trim().split(/\n\s*\n/).map((textContent) => make("p", { textContent }));
  if (stage?.kind === "consent") paragraphs.push(make("p", { className: "quiet", textContent: "If you do not agree, or have a question, tell the experimenter." }));
  $("text-title").textContent = !stage || stage.kind === "thanks" ? "Thank you" : stage.title;
  $("text-body").replaceChildren(...paragraphs);
  $("text-done").hidden = !stage;
  $("text-done").textContent = BUTTONS[stage?.kind ?? ""] ?? "";
}

$("text-done").addEventListener("click", () => act("done"));
sync.refresh();
