/** The last 20 seconds, on the server's clock: measures, haptic output and states. */

import { colors } from "../theme/colors.js";
import { drawBounds, stripsOf } from "./strips.js";

const SPAN_MS = 20_000, LEFT = 92, RIGHT = 12, RIBBON = 12, MAX_GAP_MS = 300;

export class Traces {
  /** @type {Strip[]} */ strips = [];
  /** @type {Map<string, string>} */ colors = new Map();
  /** @type {{ time_ms: number, state: string, measures: Record<string, number> }[]} */ steps = [];
  /** @type {HapticEdge[]} */ edges = [];
  /** Duration of a pulse with the pause after it, by pattern [ms]. @type {Map<string, number>} */ periods = new Map();
  width = 0; height = 0; now_ms = NaN; period_ms = 0;

  constructor(/** @type {HTMLCanvasElement} */ canvas, /** @type {import("./clock.js").ServerClock} */ clock) {
    this.canvas = canvas;
    this.context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d", { alpha: false }));
    this.clock = clock;
    new ResizeObserver(() => this.fit()).observe(canvas);
  }

  begin(/** @type {Procedure} */ procedure) {
    this.colors = new Map(procedure.states.map((state) => [state.name, state.color]));
    this.periods = new Map(procedure.patterns.map(({ name, on_ms, off_ms }) => [name, on_ms + off_ms]));
    this.strips = stripsOf(procedure.relations);
    this.clear();
  }

  clear() { this.steps = []; this.edges = []; }

  add(/** @type {ImageHeader} */ { time_ms, state, measures, plays }) {
    this.period_ms = this.periods.get(plays) ?? 0;
    const last = this.steps.at(-1);
    if (last && time_ms < last.time_ms) this.clear();
    this.steps.push({ time_ms, state, measures });
    const oldest = time_ms - SPAN_MS - 500;
    while (this.steps[0].time_ms < oldest) this.steps.shift();
    while (this.edges.length > 1 && this.edges[1][0] < oldest) this.edges.shift();
  }

  /** Add levels that the device received. @param {HapticEdge[]} edges */
  addEdges(edges) { this.edges.push(...edges); }

  fit() {
    const ratio = devicePixelRatio || 1;
    this.width = this.canvas.clientWidth; this.height = this.canvas.clientHeight;
    this.canvas.width = Math.round(this.width * ratio); this.canvas.height = Math.round(this.height * ratio);
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.draw();
  }

  x(/** @type {number} */ time_ms) { return LEFT + (1 - (this.now_ms - time_ms) / SPAN_MS) * (this.width - LEFT - RIGHT); }

  draw() {
    const { context: c, width, height } = this;
    if (!width) return;
    c.fillStyle = colors.panel;
    c.fillRect(0, 0, width, height);
    this.now_ms = this.clock.now_ms();
    if (!this.strips.length || !(this.now_ms >= 0)) return;
    const bottom = height - RIBBON - 18, each = bottom / (this.strips.length + 1);
    c.font = "12px " + getComputedStyle(document.body).fontFamily;
    this.strips.forEach((strip, at) => this.drawStrip(strip, at * each + 3, each - 9));
    this.drawHaptics(this.strips.length * each + 3, each - 9);
    this.drawRibbon(bottom + 2);
    this.drawTime(height - 3);
  }

  drawStrip(/** @type {Strip} */ strip, /** @type {number} */ top, /** @type {number} */ height) {
    const c = this.context, last = this.steps.at(-1)?.measures[strip.measure];
    c.textAlign = "left";
    const y = drawBounds(c, strip, { left: LEFT, width: this.width - LEFT - RIGHT, top, height }, (text, bound_y) => c.fillText(text, LEFT + 4, bound_y - 2));
    this.drawLabel(strip.label, top + 11, last === undefined || !Number.isFinite(last) ? "–" : `${last.toFixed(strip.digits)} ${strip.unit}`);
    c.strokeStyle = colors.text; c.lineWidth = 1.8; c.lineJoin = "round"; c.beginPath();
    let before_ms = -Infinity;
    for (const { time_ms, measures: { [strip.measure]: value } } of this.steps) {
      const isValid = Number.isFinite(value);
      if (isValid) c[time_ms - before_ms < MAX_GAP_MS ? "lineTo" : "moveTo"](Math.max(this.x(time_ms), LEFT), y(value));
      before_ms = isValid ? time_ms : -Infinity;
    }
    c.stroke();
  }

  /** Return the strongest level within the present pattern's last pulse and pause: a pause between two pulses is no silence. */
  level() {
    const since_ms = this.now_ms - this.period_ms;
    return Math.max(0, ...this.edges.filter((_, at) => (this.edges[at + 1]?.[0] ?? Infinity) > since_ms).map(([, amplitude]) => amplitude));
  }

  drawHaptics(/** @type {number} */ top, /** @type {number} */ height) {
    const c = this.context, right = this.width - RIGHT, level = this.level();
    this.drawLabel("haptics", top + 11, level ? `${Math.round(level * 100)} %` : "silent");
    c.strokeStyle = colors.line; c.beginPath(); c.moveTo(LEFT, top + height); c.lineTo(right, top + height); c.stroke();
    c.fillStyle = colors.warn;
    this.edges.forEach(([time_ms, amplitude], at) => {
      if (!amplitude) return;
      const end = this.edges[at + 1] ? this.x(this.edges[at + 1][0]) : right;
      const start = Math.max(this.x(time_ms), LEFT);
      if (end > LEFT) c.fillRect(start, top + height * (1 - amplitude), Math.max(end - start, 1), height * amplitude);
    });
  }

  drawRibbon(/** @type {number} */ top) {
    const c = this.context;
    this.steps.forEach((step, at) => {
      const start = Math.max(this.x(step.time_ms), LEFT), next = this.steps[at + 1];
      const end = next ? this.x(next.time_ms) : Math.min(this.x(step.time_ms + 40), this.width - RIGHT);
      if (end <= LEFT) return;
      c.fillStyle = this.colors.get(step.state) ?? colors.quiet;
      c.fillRect(start, top, end - start + 0.5, RIBBON - 4);
      c.fillStyle = colors.quiet;  // because some states are as light as the page
      c.fillRect(start, top + RIBBON - 4, end - start + 0.5, 1);
    });
    this.drawLabel("state", top + 9, "");
  }

  drawTime(/** @type {number} */ bottom) {
    const c = this.context;
    c.fillStyle = colors.quiet; c.textAlign = "center";
    for (let ago = 0; ago <= 20; ago += 5) c.fillText(ago ? `${ago} s` : "now", Math.min(this.x(this.now_ms - ago * 1000), this.width - RIGHT - 8), bottom);
  }

  drawLabel(/** @type {string} */ text, /** @type {number} */ y, /** @type {string} */ value) {
    const c = this.context;
    c.textAlign = "left"; c.fillStyle = colors.quiet; c.fillText(text, 2, y);
    c.fillStyle = colors.text; c.save(); c.font = c.font.replace("12px", "bold 15px"); c.fillText(value, 2, y + 18); c.restore();
  }
}
