/** The experimenter's live monitor: the parts of the live page that show how a trial goes. */

import { animate } from "../common/animate.js";
import { $, setText } from "../common/dom.js";
import { Banner, StatePanel } from "../common/state_panel.js";
import { Traces } from "../common/traces.js";
import { View } from "../common/view.js";

const DRAW_MS = 1000 / 10;

export class Monitor {
  isOn = false;
  /** Whose trials it has shown; null: not known yet. @type {string | null} */ participant = null;
  panel = new StatePanel();
  banner = new Banner();
  view = new View($("view"), $("overlays"));

  constructor(/** @type {import("../common/feed.js").Feed} */ feed) {
    this.feed = feed;
    this.view.onDrawn = (header) => feed.noteDrawn(header);
    this.traces = new Traces($("traces"), feed.clock);
    feed.haptics.add({ play: ({ amplitude }) => this.panel.showAmplitude(amplitude) });
    animate(() => DRAW_MS, () => this.draw());
  }

  begin(/** @type {Hello} */ hello) {
    const { title } = document;
    this.panel.begin(hello);
    document.title = title;
    this.view.begin(hello);
    this.traces.begin(hello.procedure);
  }

  show(/** @type {ImageHeader} */ header, /** @type {Picture} */ picture) {
    this.panel.show(header);
    this.traces.add(header);
    this.view.show(header, picture);
    setText($("hand"), header.hand ? (header.hand.engaged ? "● moving the instrument" : "○ at rest") : "");
  }

  /** @param {Health} health empty between trials */
  showHealth(health) { if (health.rate_hz === undefined) $("health").replaceChildren(); else this.panel.showHealth(health, this.feed.latency_ms); }

  /** Show whether a trial runs, and no more than blinding permits. @param {ExperimenterStatus} status */
  showStatus({ trial_status, shows_conditions, current }) {
    const participant = current?.participant ?? "";
    if (this.participant !== null && participant !== this.participant && !trial_status) this.clear();
    this.participant = participant;
    this.isOn = trial_status === "running" || trial_status === "ending";
    $("idle").hidden = this.isOn;
    const what = shows_conditions ? "the eye with the instrument, the surgical state, the haptic output, and distance and angle over time" : "the eye with the instrument";
    setText($("idle").children[0], trial_status === "preparing" ? "Preparing the trial …" : "No trial is running.");
    setText($("idle").children[1], this.feed.hello ? "" : `During a trial you see here ${what}.`);
    $("monitor").classList.toggle("on", this.isOn);
    $("monitor").classList.toggle("empty", !this.feed.hello);
    $("monitor").classList.toggle("blind", !shows_conditions);
    $("procedure").hidden = !shows_conditions;
  }

  /** Remove the last trial: it is another participant's. */
  clear() {
    this.feed.hello = this.feed.header = null;
    this.view.begin(null);
    this.traces.clear();
    this.panel.clear();
    setText($("hand"), "");
  }

  draw() {
    const problem = this.isOn && !this.feed.ended ? this.feed.problem() : null;
    this.banner.update(problem);
    $("view").classList.toggle("lost", problem?.isCut || this.feed.header?.has_picture === false);
    this.traces.draw();
  }
}
