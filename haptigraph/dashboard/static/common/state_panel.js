/** The panels that sum up a run: state, reason, haptic output, health; and the banner when the view is unreliable. */

import { $, make, setText } from "./dom.js";
import { iconShapes } from "./icons.js";

const BANNER_DELAY_MS = 200, MIN_BANNER_MS = 600, RECENT_MS = 10_000;

export class StatePanel {
  /** @type {Hello} */ hello;
  state = "";

  begin(/** @type {Hello} */ hello) {
    this.hello = hello;
    this.states = new Map(hello.procedure.states.map((state) => [state.name, state]));
    this.patterns = new Map(hello.procedure.patterns.map((pattern) => [pattern.name, pattern]));
    this.state = "";
    $("source").textContent = $("source").title = hello.source;
    $("procedure").textContent = `${hello.procedure.title} · ${hello.procedure.sha256.slice(0, 8)}`;
    document.title = `haptigraph · ${hello.source}`;
  }

  show(/** @type {ImageHeader} */ header) {
    if (header.state !== this.state) this.showState(header.state);
    setText($("because"), `${header.because}.`);
    setText($("feels"), feltText(this.patterns?.get(header.plays), header.forces));
    document.body.dataset.index = String(header.index);
    document.body.dataset.state = header.state;
  }

  /** Show no step. */
  clear() {
    this.state = "";
    for (const name of /** @type {const} */ (["state", "because", "feels"])) setText($(name), "");
    $("icon").replaceChildren();
    this.showAmplitude(0);
  }

  showState(/** @type {string} */ name) {
    const state = this.states?.get(name) ?? this.states?.get("unknown");
    this.state = name;
    if (!state) return;
    setText($("state"), state.label);
    $("icon").replaceChildren(...iconShapes(state));
    document.querySelector("main")?.style.setProperty("--state", state.color);
  }

  showAmplitude(/** @type {number} */ amplitude) {
    const meter = $("amplitude");
    meter.setAttribute("aria-valuenow", String(amplitude));
    if (meter.firstElementChild instanceof HTMLElement) meter.firstElementChild.style.transform = `scaleX(${amplitude})`;
  }

  showHealth(/** @type {Health} */ health, /** @type {number} */ pageLatency_ms) {
    const { device, recording } = this.hello;
    const fault = (/** @type {string} */ where) => {
      const [time_ms, message] = health.faults[where] ?? [-Infinity, ""];
      return health.now_ms - time_ms < RECENT_MS ? message : "";
    };
    const deviceFault = health.faults.device?.[1] ?? "", recorded = `recording${health.dropped ? `, ${health.dropped} lost` : ""}`;
    const late = health.overruns + health.skipped;
    $("health").replaceChildren(
      chip(health.rate_hz < 0.8 * health.nominal_hz, health.rate_hz.toFixed(1), "images/s", `Nominal rate: ${health.nominal_hz}`),
      chip((health.latency_p99_ms ?? 0) > 100, ms(health.latency_p50_ms), `ms from image to hand (99 %: ${ms(health.latency_p99_ms)})`, "From an image to its haptic command: the median, and what 99 % of images stay below"),
      chip(pageLatency_ms > 200, ms(pageLatency_ms), "ms to page", "From an image to this page"),
      chip(false, String(late), late === 1 ? "image late or skipped" : "images late or skipped", "Images that the loop processed too late, or left out to catch up", "plain"),
      chip(deviceFault || fault("guard"), "", `device ${device.split(":")[0]}${deviceFault && `: ${deviceFault}`}`, deviceFault || fault("guard")),
      chip(fault("recorder") || health.dropped, "", recording ? recorded : "not recorded", recording, recording ? "" : "plain"),
      chip(false, String(health.viewers.length), health.viewers.length === 1 ? "viewer" : "viewers", health.viewers.join(", "), "plain"),
      ...(health.broken.length ? [brokenClaims(health.broken)] : []),
    );
  }
}

/** The banner: appears when a problem has lasted for a moment, and stays for long enough to be read. */
export class Banner {
  /** @type {number | null} */ since_ms = null;
  shown_ms = -Infinity;

  update(/** @type {Problem | null} */ problem, now_ms = performance.now()) {
    const banner = $("banner");
    if (problem) {
      this.since_ms ??= now_ms;
      if (banner.hidden && now_ms - this.since_ms < BANNER_DELAY_MS && !problem.isCut) return;
      if (banner.hidden) this.shown_ms = now_ms;
      banner.hidden = false;
      banner.classList.toggle("cut", problem.isCut);
      banner.classList.toggle("small", problem.isSmall ?? false);
      setText(banner.children[0], problem.title);
      setText(banner.children[1], problem.detail);
    } else {
      this.since_ms = null;
      if (!banner.hidden && now_ms - this.shown_ms > MIN_BANNER_MS) banner.hidden = true;
    }
  }
}

/** Return what perception could not provide, or null. @param {ImageHeader} header @param {Hello} hello @returns {Problem | null} */
export function perceptionProblem(header, hello) {
  const state = hello.procedure.states.find(({ name }) => name === header.state), isCut = false;
  if (state?.icon === "tipless") return { title: "Tip not visible", detail: `${header.because}. ${feltWithoutTip(state, hello)}`, isCut };
  if (state?.icon !== "lost") return null;
  const fault = header.faults.at(-1), off = "Haptic output is off.";
  if (!header.has_picture) return { title: "No image", detail: `${fault ?? "the source delivers nothing"}. ${off}`, isCut };
  if (fault) return { title: "Perception failed", detail: `${fault}. ${off}`, isCut };
  return { title: "No instrument detected", detail: hello.steerable ? `Move it into view. ${off}` : off, isCut };
}

/** @param {StateDescription} state @param {Hello} hello */
function feltWithoutTip({ feel }, { procedure }) {
  const pattern = procedure.patterns.find(({ name }) => name === feel);
  return !pattern || pattern.kind === "off" ? "Haptic output is off." : `Only '${feel}' is felt.`;
}

/** What is commanded, whether or not a device exerts the force. @param {Pattern | undefined} pattern @param {string[]} forces */
export function feltText(pattern, forces) {
  const vibration = patternText(pattern);
  if (!forces.length) return vibration;
  return `${vibration === "nothing" ? "no vibration" : vibration}; force commanded: ${forces.join(", ")}`;
}

/** @param {Pattern} [pattern] */
function patternText(pattern) {
  if (!pattern || pattern.kind === "off") return "nothing";
  const what = { continuous: "steady vibration", pulses: "rapid pulses", bursts: pattern.count === 1 ? "one burst" : `${pattern.count} bursts` }[pattern.kind];
  return `${what}, ${Math.round(pattern.amplitude * 100)} %`;
}

function brokenClaims(/** @type {BrokenClaim[]} */ broken) {
  const count = broken.reduce((sum, { times }) => sum + times, 0);
  const details = broken.map(({ claim, times, worst, unit }) => `"${claim}" broken ${times} ×, at worst ${worst} ${unit}`);
  return chip(true, `${count} ×`, broken.length === 1 ? "claim broken" : "claims broken", details.join("; "));
}

/** @param {unknown} isBad @param {string} value @param {string} text @param {string} title @param {string} [className] */
function chip(isBad, value, text, title, className = "") {
  return make("li", { title, className: isBad ? "bad" : className }, value && make("b", { textContent: value }), text);
}

function ms(/** @type {number | null} */ value) { return value === null || Number.isNaN(value) ? "–" : value.toFixed(value < 10 ? 1 : 0); }
