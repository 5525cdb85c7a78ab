/** The calibration on the participant's page: play a vibration, then say whether it was felt, or which one it was. */

import { $, make, setText } from "../common/dom.js";

const HINT = "Now pay attention to your hand.";
/** @type {Record<string, string>} */
const TEXTS = {
  "calibration/threshold": "Hold the device as you will during the task. Press Play: half a second later it vibrates, sometimes faintly, and sometimes not at all. Then say whether you felt anything.",
  "calibration/patterns": "Press Play: the device plays one of the patterns. Then say which one it was. If you are not sure, guess.",
};

export class Calibration {
  shown = "";
  /** @type {CalibrationStage | null} */ stage = null;
  /** @type {HTMLElement | null} */ next = null;

  /** @param {(name: string, content: object) => Promise<boolean>} act sends an action in the present stage */
  constructor(act) {
    this.act = act;
    $("try").addEventListener("click", () => this.play());
    document.addEventListener("keydown", (event) => this.choose(event));
  }

  /** Show a task's instructions and buttons. @param {CalibrationStage} stage */
  begin(stage) {
    this.shown = "";
    $("calibration-title").textContent = stage.title;
    $("calibration-text").textContent = TEXTS[stage.key] ?? "";
    this.fill($("learn"), stage.choices, (name) => this.play(name));
    this.fill($("choices"), stage.choices, (name) => this.respond(name));
  }

  /** Put a button for each name into a group. @param {HTMLFieldSetElement} group @param {string[]} names @param {(name: string) => void} press */
  fill(group, names, press) {
    for (const button of group.querySelectorAll("button")) button.remove();
    names.forEach((name, at) => {
      const button = make("button", { type: "button", className: "large" }, group.id === "choices" && make("kbd", {}, `${at + 1}`), ` ${label(name)}`);
      button.addEventListener("click", () => press(name));
      group.append(button);
    });
  }

  /** Show where the task is; the focus follows what comes next. @param {CalibrationStage} stage @param {TrialStatus} status */
  show(stage, status) {
    this.stage = stage;
    const isPlaying = status !== "", isOver = stage.played && !isPlaying;
    $("calibration-count").textContent = `${stage.number} of ${stage.of}${stage.round > 1 ? `, round ${stage.round}` : ""}`;
    setText($("calibration-status"), isPlaying ? HINT : "");
    $("learn").hidden = !stage.may_learn || isPlaying || isOver;
    $("try").hidden = isPlaying || isOver;
    $("choices").hidden = !isOver;
    const now = `${stage.key} ${stage.number} ${isPlaying ? "playing" : isOver}`;
    if (this.shown && now !== this.shown && !isPlaying) this.next = isOver ? $("choices") : $("try");
    this.shown = now;
    this.takeFocus();
  }

  /** Focus what comes next, as soon as it is enabled again. */
  takeFocus() {
    if (!this.next || ("disabled" in this.next && this.next.disabled)) return;
    this.next.focus();
    this.next = null;
  }

  play(pattern = "") { return this.act("play", { number: this.stage?.number, pattern }); }

  respond(/** @type {string} */ response) { return this.act("respond", { number: this.stage?.number, response, page_output: outputs() }); }

  /** The digits choose an answer. @param {KeyboardEvent} event */
  choose(event) {
    if ($("calibration").hidden || $("choices").hidden || event.repeat) return;
    const response = this.stage?.choices[Number(event.key) - 1];
    if (response) this.respond(response);
  }
}

/** Return the outputs of this page that are switched on, as the experimenter reads them. */
function outputs() {
  const labels = [...$("outputs").querySelectorAll("label")].filter((each) => each.querySelector("input")?.checked);
  return labels.map((each) => (each.textContent ?? "").trim()).filter((name) => name !== "Needs clutch").join(", ").slice(0, 200);
}

function label(/** @type {string} */ name) { return name.replaceAll("_", " ").replace(/^./, (first) => first.toUpperCase()); }
