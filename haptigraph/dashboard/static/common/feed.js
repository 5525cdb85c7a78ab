/** The state of a live view: the connection, the newest messages, the server's clock, and what is wrong. */

import { ServerClock } from "./clock.js";
import { connect } from "./socket.js";
import { perceptionProblem } from "./state_panel.js";

const PING_MS = 2000;
const SLOW_MS = 1000; // a late image is a problem for so long

export class Feed {
  clock = new ServerClock();
  /** @type {Hello | null} */ hello = null;
  /** @type {ImageHeader | null} */ header = null;
  drawn = 0; received_ms = -Infinity; latency_ms = NaN; late_ms = 0; loop_ms = 0; wasLate_ms = -Infinity; ended = ""; isOpen = false;

  /** Tests and benchmarks read the fields, and may set `onImage` and `onDrawn`.
   *  @param {import("./haptics.js").Haptics} haptics @param {FeedHandlers} handlers @param {string} [path] of the socket */
  constructor(haptics, handlers, path = "/live") {
    this.haptics = haptics;
    this.onImage = this.onDrawn = (/** @type {ImageHeader} */ _header) => {};
    /** @type {FeedHandlers} */ const own = {
      hello: (hello) => { this.hello = hello; this.header = null; this.ended = ""; haptics.stale_ms = hello.deadman_ms; },
      haptics: ({ edges }) => haptics.setLevel(edges),
      alive: ({ time_ms }) => haptics.keepAlive(this.clock.page_ms(time_ms)),
      pong: ({ time_ms, now_ms }) => this.clock.addPing(time_ms, now_ms),
      ended: ({ reason }) => { this.ended = reason; haptics.silence(); },
      error: ({ message }) => console.warn(message),
      image: (header) => {
        this.header = header;
        this.received_ms = performance.now();
        const captured_ms = this.clock.page_ms(header.time_ms);
        haptics.keepAlive(captured_ms);
        if (this.received_ms - captured_ms > haptics.stale_ms) {
          [this.late_ms, this.wasLate_ms] = [this.received_ms - captured_ms, this.received_ms];
          this.loop_ms = header.commanded_ms - header.time_ms;
        }
        this.onImage(header);
      },
    };
    const { send } = connect({
      onText: (type, message) => { own[type]?.(message); handlers[type]?.(message); },
      onImage: (header, picture) => { own.image(header, picture); handlers.image(header, picture); },
      onOpen: () => { this.isOpen = true; this.clock.reset(); this.ping(); this.watch(); handlers.opened?.(); },
      onLost: () => { this.isOpen = false; haptics.silence(); handlers.lost?.(); },
    }, path);
    this.send = send;
    setInterval(() => this.ping(), PING_MS);
    for (const wait_ms of [50, 100, 200, 400]) setTimeout(() => this.ping(), wait_ms);
    const leave = () => { haptics.silence(); handlers.hidden?.(); };
    document.addEventListener("visibilitychange", () => {
      if (document.hidden) leave();
      this.received_ms = performance.now();
      this.watch();
    });
    addEventListener("pagehide", leave);
    document.addEventListener("freeze", leave);
  }

  /** Note that an image is on the screen. @param {ImageHeader} header */
  noteDrawn(header) {
    this.drawn += 1;
    this.onDrawn(header);
    const age_ms = this.clock.now_ms() - header.time_ms;
    this.latency_ms = Number.isNaN(this.latency_ms) ? age_ms : this.latency_ms + 0.1 * (age_ms - this.latency_ms);
  }

  /** Return what makes the view unreliable at present, or null. @returns {Problem | null} */
  problem() {
    if (!this.isOpen) return { title: "Connection lost", detail: "The server does not respond; this view is out of date.", isCut: true };
    if (this.ended) return { title: "The run has ended", detail: this.ended, isCut: true };
    if (!this.header || !this.hello) return null;
    const silent_ms = performance.now() - this.received_ms;
    if (silent_ms > 200 + 2 * this.hello.stale_ms) return { title: "No data received", detail: `Nothing from the loop for ${(silent_ms / 1000).toFixed(1)} s.`, isCut: true };
    if (performance.now() - this.wasLate_ms < SLOW_MS) return this.lateness(this.hello);
    return perceptionProblem(this.header, this.hello);
  }

  /** Return whether the loop or the connection makes images late. @param {Hello} hello @returns {Problem} */
  lateness({ deadman_ms }) {
    const seconds = (/** @type {number} */ ms) => `${(ms / 1000).toFixed(1)} s`, isLoop = this.loop_ms > this.late_ms / 2;
    const how = isLoop ? `The loop takes ${seconds(this.loop_ms)} for an image` : `Images may be ${seconds(this.late_ms)} old when they arrive`;
    const title = isLoop ? "Perception or machine too slow" : "Connection too slow";
    return { title, detail: `${how}; this page's haptic feedback stops after ${deadman_ms} ms.`, isCut: false, isSmall: true };
  }

  ping() { this.send({ type: "ping", time_ms: performance.now() }); }
  watch() { this.send({ type: "watch", images: !document.hidden }); }
}
