/** A trial on the participant's page: instructions, picture, steering and haptic feedback. */

import { animate } from "../common/animate.js";
import { Controller } from "../live/gamepad.js";
import { $, checkbox, setText } from "../common/dom.js";
import { addOutputs } from "../live/outputs.js";
import { Phases } from "../live/phases.js";
import { controllerText } from "../live/rumble.js";
import { Banner } from "../common/state_panel.js";
import { Steering } from "../live/steering.js";
import { TouchCheck } from "./touch_check.js";
import { View } from "../common/view.js";

/** @type {Record<TrialStage["display"], Overlay[]>} */
const DISPLAYS = { ioct: ["target", "port"], overlays: ["target", "port", "needle", "cone", "zone"] };
const DRAW_MS = 1000 / 20, FROZEN_MS = 1000;

export class Trial {
  me = ""; holder = ""; title = "";
  /** @type {TrialStatus} */ status = "";
  picture_ms = 0;
  view = new View($("view"), null);
  banner = new Banner();
  controller = new Controller();

  constructor(/** @type {import("../common/feed.js").Feed} */ feed, /** @type {(name: string, more?: object) => Promise<boolean>} */ act) {
    this.feed = feed;
    this.view.onDrawn = (header) => feed.noteDrawn(header);
    this.steering = new Steering(feed.send, this.controller, $("view"), feed.clock);
    this.phases = new Phases($("phases"), feed.send);
    this.touch = new TouchCheck(feed, addOutputs(feed.haptics, this.controller, $("outputs")), act);
    $("outputs").append(checkbox("Needs clutch", false, (isOn) => { this.steering.needsClutch = isOn; }, "needs-clutch"));
    $("begin").addEventListener("click", () => act("begin"));
    $("finish").addEventListener("click", () => act("ready"));
    document.addEventListener("visibilitychange", () => { this.takeControls(); this.touch.name(); });
    animate(() => DRAW_MS, () => this.draw());
  }

  /** Show the instructions of a trial. @param {TrialStage} stage @param {TrialStatus} status */
  begin(stage, status) {
    const limit = stage.timeout_s >= 120 ? `${Math.round(stage.timeout_s / 60)} minutes` : `${stage.timeout_s} seconds`;
    $("trial-title").textContent = stage.title;
    $("trial-condition").textContent = stage.condition === stage.kind ? "" : stage.condition;
    $("trial-text").textContent = stage.free
      ? `Practise freely for up to ${limit}. When you want to go on, press “I am ready”.`
      : `Bring the tip of the needle to the marked target. You have up to ${limit}.`;
    this.view.choose(DISPLAYS[stage.display]);
    if (!status) this.view.begin(null);  // clears the picture of the trial before
  }

  /** @param {TrialStatus} status @param {StageSummary} stage @param {TouchStatus} [touch] */
  showStatus(status, stage, touch = { output: "", problem: "" }) {
    this.touch.show(touch);
    const isOn = status === "running";
    $("ready").hidden = status !== "" && status !== "stimulus";
    $("finish").hidden = !(isOn && stage.free);
    this.title = stage.title;
    if (isOn && this.status !== "running") {
      this.picture_ms = performance.now();
      $("view").focus();  // so that the space bar is the clutch, and presses no button
    }
    this.status = status;
    this.setHolder(this.holder);
  }

  beginRun(/** @type {Hello} */ hello) {
    for (const part of [this.view, this.phases, this.steering]) part.begin(hello);
    $("jaws").hidden = !hello.has_jaws;
    this.takeControls();
  }

  show(/** @type {ImageHeader} */ header, /** @type {Picture} */ picture) {
    if (picture) this.picture_ms = performance.now();
    this.view.show(header, picture);
    this.phases.show(header);
  }

  /** Whether a trial runs; the loop's end comes before that of the trial, which is saved meanwhile. */
  get isOn() { return this.status === "running" && !this.feed.ended; }

  /** Note who has the controls, and take them if they are free. @param {string} holder */
  setHolder(holder) {
    this.holder = holder;
    const isMine = holder !== "" && holder === this.me && this.status === "running";
    if (this.steering.isHolder && !isMine) this.steering.release();
    this.steering.isHolder = isMine;  // between trials keys keep their meaning on the page
    this.phases.allow(isMine || holder === "");
    this.takeControls();
  }

  takeControls() { if (this.holder === "" && this.feed.hello?.steerable && !document.hidden) this.feed.send({ type: "take_controls" }); }

  release() {
    this.steering.release();
    if (document.hidden) this.feed.send({ type: "release_controls" });
  }

  draw() {
    const isOn = this.isOn, { engaged } = this.steering;
    const others = this.holder && this.holder !== this.me ? "Another page has the controls; close it." : "";
    $("pad").textContent = controllerText(this.controller.pad());
    this.touch.name();
    const hint = isOn && !this.view.hasEntered && View.portOf(this.feed.hello) ? `${this.title}: enter through the marked port` : this.title;
    const finished = "Finished. One moment, please …";
    setText($("trial-status"), { "": "", preparing: "One moment, please …", running: isOn ? hint : finished, stimulus: "", ending: finished }[this.status]);
    $("keys").hidden = !isOn || !this.feed.hello?.steerable;
    $("clutch").textContent = !isOn || !this.feed.hello?.steerable ? "" : others || (engaged ? "● moving the instrument" : "○ at rest");
    $("clutch").classList.toggle("on", engaged);
    const isFrozen = isOn && performance.now() - this.picture_ms > FROZEN_MS;
    this.banner.update(isFrozen ? { title: "The picture is frozen", detail: "Please wait a moment. Haptic feedback is off.", isCut: true } : null);
    if (!isOn) $("banner").hidden = true;  // at once, so that it does not lie over the next card
    $("view").classList.toggle("lost", isFrozen || !isOn);
  }
}
