/** What every page with a live view shares: the line, what was heard last, the server's clock, what is lost. */

import { ServerClock } from "./clock.js";
import { connect } from "./socket.js";
import { lostIn } from "./status.js";

const PING_MS = 2000;

export class Feed {
  /**
   * Tests and benchmarks read the fields, and may listen: `onImage`, `onDrawn`.
   *
   * @param {import("./touch.js").Touch} touch
   * @param {Record<string, (...what: any[]) => void>} hear a message by its type; `image(header, picture)`,
   *     `opened()`, `lost()` and `hidden()`
   */
  constructor(touch, hear) {
    Object.assign(this, {
      touch, hear, clock: new ServerClock(), hello: null, header: null, drawn: 0, onImage: () => {}, onDrawn: () => {},
      heard_ms: -Infinity, latency_ms: NaN, ended: "", isOpen: false,
    });
    this.line = connect({
      onText: (message) => { this[`take_${message.type}`]?.(message); hear[message.type]?.(message); },
      onImage: (header, picture) => this.take(header, picture),
      onOpen: () => { this.isOpen = true; this.clock.reset(); this.ping(); this.watch(); hear.opened?.(); },
      onLost: () => { this.isOpen = false; touch.silence(); hear.lost?.(); },
    });
    this.send = (message) => this.line.send(message);
    setInterval(() => this.ping(), PING_MS);
    for (const wait_ms of [50, 100, 200, 400]) setTimeout(() => this.ping(), wait_ms);
    document.addEventListener("visibilitychange", () => {
      if (document.hidden) { touch.silence(); hear.hidden?.(); }
      this.heard_ms = performance.now();
      this.watch();
    });
    addEventListener("pagehide", () => { touch.silence(); hear.hidden?.(); });
  }

  take_hello(message) {
    this.hello = message;
    this.header = null;
    this.ended = "";
    this.touch.stale_ms = message.deadman_ms;
  }
  take_touch({ edges }) { this.touch.told(edges); }
  take_pong({ time_ms, now_ms }) { this.clock.heard(time_ms, now_ms); }
  take_ended({ reason }) { this.ended = reason; this.touch.silence(); }
  take_error({ message }) { console.warn(message); }

  take(header, picture) {
    this.header = header;
    this.heard_ms = performance.now();
    this.touch.fresh();
    this.onImage(header);
    this.hear.image(header, picture);
  }

  /** Note that an image is on the screen. */
  wasDrawn(header) {
    this.drawn += 1;
    this.onDrawn(header);
    const age_ms = this.clock.now_ms() - header.time_ms;
    this.latency_ms = Number.isNaN(this.latency_ms) ? age_ms : this.latency_ms + 0.1 * (age_ms - this.latency_ms);
  }

  /** Say what cannot be trusted now: words, details, and whether the page itself is cut off; null if all is well. */
  lost() {
    if (!this.isOpen) return ["Connection lost", "The server does not answer. What you see is old.", true];
    if (this.ended) return ["The run has ended", this.ended, true];
    const silent_ms = performance.now() - this.heard_ms;
    if (this.header && silent_ms > 200 + 2 * this.hello.stale_ms) return ["No news", `Nothing from the loop for ${(silent_ms / 1000).toFixed(1)} s.`, true];
    return this.header && lostIn(this.header, this.hello);
  }

  ping() { this.line.send({ type: "ping", time_ms: performance.now() }); }
  watch() { this.line.send({ type: "watch", images: !document.hidden }); }
}
