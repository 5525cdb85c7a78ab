/** The experimenter's live monitor: the parts of the live page that tell how a trial goes. Steers nothing. */

import { every } from "../server/animate.js";
import { Banner, Status } from "../server/status.js";
import { Traces } from "../server/traces.js";
import { View } from "../server/view.js";

const DRAW_MS = 1000 / 10;
const $ = (id) => document.getElementById(id);

export class Monitor {
  /** @param {import("./feed.js").Feed} feed */
  constructor(feed) {
    Object.assign(this, { feed, isOn: false, title: "" });
    this.view = new View($("view"), $("overlays"));
    this.view.onDrawn = (header) => feed.wasDrawn(header);
    this.status = new Status();
    this.banner = new Banner();
    this.traces = new Traces($("traces"), feed.clock);
    feed.touch.add({ play: (level) => this.status.amplitude(level.amplitude) });
    every(() => DRAW_MS, () => this.draw());
  }

  hello(message) {
    const { title } = document;
    this.status.begin(message);
    document.title = title;
    this.view.begin(message);
    this.traces.begin(message.procedure);
  }

  image(header, picture) {
    this.status.show(header);
    this.traces.add(header);
    this.view.show(header, picture);
    const hand = header.hand && (header.hand.engaged ? "● the hand moves the instrument" : "○ the hand is off");
    if ($("hand").textContent !== (hand ?? "")) $("hand").textContent = hand ?? "";
  }

  health(message) { if (message.rate_hz === undefined) $("health").replaceChildren(); else this.status.health(message, this.feed.latency_ms); }

  /** Take note of whether a trial runs, and whether its condition may be told by what is shown. */
  now({ doing, shows_all }) {
    this.isOn = doing === "running" || doing === "ending";
    $("idle").hidden = this.isOn;
    $("idle").textContent = doing === "preparing" ? "The trial is being prepared …" : "No trial is running.";
    $("monitor").classList.toggle("on", this.isOn);
    $("monitor").classList.toggle("empty", !this.feed.hello);
    $("monitor").classList.toggle("blind", !shows_all);
    $("procedure").hidden = !shows_all;
  }

  draw() {
    const what = this.isOn && !this.feed.ended ? this.feed.lost() : null;
    this.banner.update(what);
    $("view").classList.toggle("lost", Boolean(what?.[2]) || this.feed.header?.has_picture === false);
    this.traces.draw();
  }
}
