/** The large words: state, why, touch, health, and the banner when nothing can be trusted. */

import { sign } from "./signs.js";

const LOST_FOR_MS = 200, SHOWN_FOR_MS = 600;
const $ = (id) => document.getElementById(id);

export class Status {
  begin(hello) {
    this.states = Object.fromEntries(hello.procedure.states.map((state) => [state.name, state]));
    this.patterns = Object.fromEntries(hello.procedure.patterns.map((pattern) => [pattern.name, pattern]));
    this.hello = hello;
    this.state = null;
    $("source").textContent = hello.source;
    $("source").title = hello.source;
    $("procedure").textContent = `${hello.procedure.title} · ${hello.procedure.sha256.slice(0, 8)}`;
    document.title = `haptigraph · ${hello.source}`;
  }

  show(header) {
    if (header.state !== this.state) this.showState(header.state);
    set($("because"), `${header.because}.`);
    set($("feels"), felt(this.patterns[header.plays]));
    document.body.dataset.index = header.index;
    document.body.dataset.state = header.state;
  }

  showState(name) {
    const state = this.states[name] ?? this.states.unknown;
    this.state = name;
    set($("state"), state.label);
    $("sign").replaceChildren(...sign(state));
    document.querySelector("main").style.setProperty("--state", state.color);
  }

  amplitude(value) {
    const meter = $("amplitude");
    meter.setAttribute("aria-valuenow", value);
    meter.firstElementChild.style.transform = `scaleX(${value})`;
  }

  health(health, pageLatency_ms) {
    const { hello } = this;
    const fault = (where) => health.faults[where] && health.now_ms - health.faults[where][0] < 10_000 ? health.faults[where][1] : "";
    const lost = health.overruns + health.skipped;
    $("health").replaceChildren(
      chip(health.rate_hz < 0.8 * health.nominal_hz, health.rate_hz.toFixed(1), "images/s", `Of ${health.nominal_hz}`),
      chip(health.latency_p99_ms > 100, `${ms(health.latency_p50_ms)} / ${ms(health.latency_p99_ms)}`, "ms to hand", "From image to command, half of the steps and 99 %"),
      chip(pageLatency_ms > 200, ms(pageLatency_ms), "ms to page", "From image to this page"),
      chip(false, String(lost), "late", "Images the loop was late for or skipped", "plain"),
      chip(fault("device") || fault("guard"), "", `device ${hello.device.split(":")[0]}${fault("device") ? ": " + fault("device") : ""}`, fault("device") || fault("guard")),
      chip(fault("recorder") || health.dropped, "", hello.recording ? `recording${health.dropped ? `, ${health.dropped} lost` : ""}` : "not recorded", hello.recording, hello.recording ? "" : "plain"),
      chip(false, String(health.viewers.length), health.viewers.length === 1 ? "viewer" : "viewers", health.viewers.join(", "), "plain"),
      ...(health.broken.length ? [brokenClaims(health.broken)] : []),
    );
  }
}

/** The banner: what is lost, once it has been for a moment, and for as long as can be read. */
export class Banner {
  constructor() { this.since_ms = this.shown_ms = null; }

  /** @param {[string, string, boolean] | null} what words, details, and whether the page itself is cut off */
  update(what, now_ms = performance.now()) {
    const banner = $("banner");
    if (what) {
      this.since_ms ??= now_ms;
      if (banner.hidden && now_ms - this.since_ms < LOST_FOR_MS && !what[2]) return;
      if (banner.hidden) this.shown_ms = now_ms;
      banner.hidden = false;
      banner.classList.toggle("cut", what[2]);
      set(banner.children[0], what[0]);
      set(banner.children[1], what[1]);
    } else {
      this.since_ms = null;
      if (!banner.hidden && now_ms - this.shown_ms > SHOWN_FOR_MS) banner.hidden = true;
    }
  }
}

/** Say what is lost in an image message; null if nothing is. */
export function lostIn(header, hello) {
  const unknown = hello.procedure.states.find((state) => state.sign === "lost");
  if (header.state !== unknown?.name) return null;
  const fault = header.faults.at(-1);
  if (!header.has_picture) return ["No image", `${fault ?? "the source delivers nothing"}. The hand is still.`, false];
  if (fault) return ["Perception failed", `${fault}. The hand is still.`, false];
  return ["No instrument seen", hello.steerable ? "Push it into the picture. The hand is still." : "The hand is still.", false];
}

function felt(pattern) {
  if (!pattern || pattern.kind === "off") return "nothing";
  const what = { continuous: "steady vibration", pulses: "rapid pulses", bursts: `${pattern.count} bursts` }[pattern.kind];
  return `${what}, ${Math.round(pattern.amplitude * 100)} %`;
}

function brokenClaims(broken) {
  const count = broken.reduce((sum, { times }) => sum + times, 0);
  const words = broken.map(({ claim, times, most, unit }) => `"${claim}" broken ${times} ×, at worst ${most} ${unit}`);
  return chip(true, `${count} ×`, broken.length === 1 ? "claim broken" : "claims broken", words.join("; "));
}

function chip(isBad, value, words, title = "", kind = "") {
  const item = Object.assign(document.createElement("li"), { title, className: isBad ? "bad" : kind });
  if (value) item.append(Object.assign(document.createElement("b"), { textContent: value }));
  item.append(words);
  return item;
}

function ms(value) { return value === null || Number.isNaN(value) ? "–" : value.toFixed(value < 10 ? 1 : 0); }

function set(element, text) { if (element.textContent !== text) element.textContent = text; }
