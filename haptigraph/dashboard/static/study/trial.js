/** A trial on the participant's page: the picture, steering, touch, and the words before it begins. */

import { every } from "../server/animate.js";
import { Controller } from "../live/gamepad.js";
import { Phases } from "../live/phases.js";
import { Rumble, actuatorOf } from "../live/rumble.js";
import { toggle } from "../server/signs.js";
import { Frame, Tone } from "../live/standin.js";
import { Banner } from "../server/status.js";
import { Steering } from "../live/steering.js";
import { View } from "../server/view.js";

const DISPLAYS = { ioct: ["target"], overlays: ["target", "needle", "cone", "zone"] };
const DRAW_MS = 1000 / 20, STANDS_MS = 1000;
const $ = (id) => document.getElementById(id);

export class Trial {
  /**
   * @param {import("./feed.js").Feed} feed
   * @param {(name: string) => Promise<void>} act
   */
  constructor(feed, act) {
    Object.assign(this, { feed, me: "", doing: "", holder: "", seen_ms: 0 });
    this.view = new View($("view"), null);
    this.view.onDrawn = (header) => feed.wasDrawn(header);
    this.banner = new Banner();
    this.controller = new Controller();
    this.steering = new Steering(feed.send, this.controller, $("view"));
    this.phases = new Phases($("phases"), feed.send);
    this.addOutputs(feed.touch);
    $("begin").addEventListener("click", () => act("begin"));
    $("finish").addEventListener("click", () => act("ready"));
    document.addEventListener("visibilitychange", () => this.wish());
    every(() => DRAW_MS, () => this.draw());
  }

  addOutputs(touch) {
    const rumble = new Rumble(() => this.controller.pad()), frame = new Frame(), tone = new Tone();
    for (const output of [rumble, frame, tone]) touch.add(output);
    $("outputs").append(
      toggle("controller", true, (on) => rumble.enable(on), "touch-controller"),
      toggle("screen", false, (on) => frame.enable(on), "touch-screen"),
      toggle("sound", false, (on) => tone.enable(on)),
      toggle("Needs clutch", false, (on) => { this.steering.needsClutch = on; }, "needs-clutch"),
    );
  }

  /** Show what comes before a trial. */
  begin(stage, doing) {
    const most = stage.timeout_s >= 120 ? `${Math.round(stage.timeout_s / 60)} minutes` : `${stage.timeout_s} seconds`;
    $("trial-title").textContent = stage.title;
    $("trial-condition").textContent = stage.condition === stage.kind ? "" : stage.condition;
    $("trial-words").textContent = stage.free
      ? `Try everything out, as you like, for up to ${most}. When you have had enough, press “I am ready”.`
      : `Bring the tip of the needle to the marked target. You have up to ${most}.`;
    this.view.choose(DISPLAYS[stage.display]);
    if (!doing) this.view.begin(null);  // what is left of the trial before
  }

  /** Show what the trial is doing. */
  now({ doing, stage }) {
    const isOn = doing === "running";
    $("ready").hidden = doing !== "";
    $("finish").hidden = !(isOn && stage.free);
    $("doing").textContent = { "": "", preparing: "Just a moment …", running: stage.title, ending: "That was it. Just a moment …" }[doing];
    if (isOn && this.doing !== "running") {
      this.seen_ms = performance.now();
      $("view").focus();  // so that the space bar is the clutch, and presses no button
    }
    this.doing = isOn ? "running" : doing;
    this.held(this.holder);
  }

  hello(message) {
    for (const part of [this.view, this.phases, this.steering]) part.begin(message);
    $("jaws").hidden = !message.has_jaws;
    this.wish();
  }

  image(header, picture) {
    if (picture) this.seen_ms = performance.now();
    this.view.show(header, picture);
    this.phases.show(header);
  }

  /** Take note of who holds the controls, and take them where they are free. */
  held(holder) {
    this.holder = holder;
    const isMine = holder !== "" && holder === this.me && this.doing === "running";
    if (this.steering.isHolder && !isMine) this.steering.letGo();
    this.steering.isHolder = isMine;  // between trials keys are the page's
    this.phases.allow(isMine || holder === "");
    this.wish();
  }

  wish() { if (this.holder === "" && this.feed.hello?.steerable && !document.hidden) this.feed.send({ type: "take" }); }

  letGo() {
    this.steering.letGo();
    if (document.hidden) this.feed.send({ type: "release" });
  }

  draw() {
    const pad = this.controller.pad();
    $("pad").textContent = pad ? `${pad.id}${actuatorOf(pad) ? ", can vibrate" : ", cannot vibrate: switch on screen or sound"}` : "No controller: press one of its buttons to connect it";
    const isOn = this.doing === "running";
    const others = this.holder && this.holder !== this.me ? "Another page holds the controls; close it." : "";
    $("clutch").textContent = !isOn || !this.feed.hello?.steerable ? "" : others || (this.steering.engaged ? "● moving the instrument" : "○ hand is off");
    $("clutch").classList.toggle("on", this.steering.engaged);
    const stands = isOn && performance.now() - this.seen_ms > STANDS_MS;
    this.banner.update(stands ? ["The picture stands still", "Please wait a moment. The hand is still.", true] : null);
    $("view").classList.toggle("lost", stands || !isOn);
  }
}
