/** One run over time: a lane per state, differences, faults, measures, haptic output; and a cursor.
 *  Everything but the cursor is drawn once into a second canvas, so that moving the cursor is cheap. */

import { colors, onRecolor } from "../theme/colors.js";
import { drawAxis, drawCurve, drawHaptics, hatch } from "./curves.js";
import { differencesOf } from "./run.js";
import { make } from "../common/dom.js";
import { icon } from "../common/icons.js";
import { boundsOf, stripsOf } from "../common/strips.js";

const RIGHT = 14, LANE = 14, NARROW_PX = 700, MIN_SPAN_MS = 400, MIN_STRIP = 26, MIN_HAPTICS = 17;

export class Timeline {
  /** @type {RecordedRun} */ run;
  /** @type {ComparedRun | null} */ other = null;
  /** @type {Difference[]} */ differences = [];
  /** @type {StateDescription[]} */ states = [];
  /** @type {Map<string, number>} */ rows = new Map();
  /** @type {StripBox[]} one for each strip */ boxes = [];
  number = 0; from_ms = 0; to_ms = 1; left = 244; width = 0; redrawing = 0;

  /** @param {HTMLCanvasElement} canvas @param {HTMLElement} lanes takes the labels of the states
   *  @param {(time_ms: number) => void} onSeek called with the time that is clicked */
  constructor(canvas, lanes, onSeek) {
    this.canvas = canvas; this.lanes = lanes; this.onSeek = onSeek;
    this.scale = /** @type {HTMLElement} */ (canvas.parentElement);
    this.context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d", { alpha: false }));
    this.background = make("canvas");
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); this.seek(event); });
    canvas.addEventListener("pointermove", (event) => { if (event.buttons) this.seek(event); });
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    new ResizeObserver(() => this.redraw()).observe(canvas);
    onRecolor.push(() => this.redraw());
  }

  begin(/** @type {RecordedRun} */ run) {
    this.run = run;
    this.number = 0;
    [this.from_ms, this.to_ms] = [0, Math.max(run.end_ms, 1)];
    this.compare(null);
  }

  /** Show another procedure's states, bounds and haptic output beside the recorded ones. @param {ComparedRun | null} other null: no comparison */
  compare(other) {
    this.other = other;
    this.differences = other ? differencesOf(this.run, other) : [];
    const states = [...this.run.states].reverse();
    const known = new Set(states.map((state) => state.name));
    if (other) states.push(...other.states.filter((state) => !known.has(state.name)));
    this.states = states;
    this.rows = new Map(states.map((state, row) => [state.name, row]));
    this.boxes = stripsOf(this.run.content.hello.procedure.relations).map((strip) => {
      const compared = other && differing(boundsOf(strip.measure, other.content.relations), strip);
      return { strip: { ...strip, max: maxOf(this.run.measure(strip.measure), strip, compared?.bounds ?? []) }, compared, top: 0, height: 0 };
    });
    const rows = states.length + Number(Boolean(other)) + Number(this.run.content.faults.length > 0);
    this.scale.style.minHeight = `${rows * LANE + this.boxes.length * MIN_STRIP + (other ? 2 : 1) * MIN_HAPTICS + 21}px`;
    this.lanes.replaceChildren(...states.map((state) => make("li", { title: state.label }, icon(state), state.label)));
    this.redraw();
    this.show(this.number);
  }

  show(/** @type {number} */ number) {
    this.number = number;
    const state = this.run.stateAt(number);
    [...this.lanes.children].forEach((item, row) => item.classList.toggle("on", this.rows.get(state) === row));
    const time_ms = this.run.time_ms[number], span_ms = this.to_ms - this.from_ms;
    if (time_ms < this.from_ms || time_ms > this.to_ms) this.setRange(time_ms - span_ms / 2, span_ms);
    this.draw();
  }

  /** Show more (factor > 1) or less of the run around a time. @param {number} factor @param {number} [center_ms] */
  zoom(factor, center_ms = this.run.time_ms[this.number]) {
    const span_ms = Math.max((this.to_ms - this.from_ms) * factor, MIN_SPAN_MS);
    const share = (center_ms - this.from_ms) / (this.to_ms - this.from_ms);
    this.setRange(center_ms - share * span_ms, span_ms);
  }

  setRange(/** @type {number} */ from_ms, /** @type {number} */ span_ms) {
    const end_ms = Math.max(this.run.end_ms, 1), width_ms = Math.min(span_ms, end_ms);
    this.from_ms = Math.min(Math.max(from_ms, 0), end_ms - width_ms);
    this.to_ms = this.from_ms + width_ms;
    cancelAnimationFrame(this.redrawing);  // wheel events come faster than a long run is drawn
    this.redrawing = requestAnimationFrame(() => this.redraw());
  }

  wheel(/** @type {WheelEvent} */ event) {
    if (!this.run) return;
    event.preventDefault();
    const span_ms = this.to_ms - this.from_ms;
    if (Math.abs(event.deltaX) > Math.abs(event.deltaY) || event.shiftKey) this.setRange(this.from_ms + (event.deltaX || event.deltaY) / 800 * span_ms, span_ms);
    else this.zoom(Math.exp(event.deltaY / 500), this.timeAt(event));
  }

  seek(/** @type {MouseEvent} */ event) { if (this.run) this.onSeek(this.timeAt(event)); }

  timeAt(/** @type {MouseEvent} */ event) {
    const share = (event.clientX - this.canvas.getBoundingClientRect().left - this.left) / this.width;
    return this.from_ms + Math.min(Math.max(share, 0), 1) * (this.to_ms - this.from_ms);
  }

  x(/** @type {number} */ time_ms) { return this.left + (time_ms - this.from_ms) / (this.to_ms - this.from_ms) * this.width; }

  /** Whether there is no room for the names of states beside their lanes. */
  get isNarrow() { return this.canvas.clientWidth < NARROW_PX; }

  /** Draw the background, then the cursor. */
  redraw() {
    const ratio = devicePixelRatio || 1, width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    if (!this.run || !width) return;
    this.left = this.isNarrow ? 96 : 244;
    this.width = width - this.left - RIGHT;
    this.lanes.classList.toggle("short", this.isNarrow);
    for (const each of [this.canvas, this.background]) Object.assign(each, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    const c = /** @type {CanvasRenderingContext2D} */ (this.background.getContext("2d", { alpha: false }));
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.font = "12px " + getComputedStyle(document.body).fontFamily;
    c.fillStyle = colors.panel;
    c.fillRect(0, 0, width, height);
    let top = this.drawLanes(c);
    if (this.other) top = this.drawDifferences(c, top);
    if (this.run.content.faults.length) top = this.drawFaults(c, top);
    const { boxes, run, other } = this;
    const haptics = other ? Math.max(2 * MIN_HAPTICS, (height - 18 - top) * 0.3) : (height - 18 - top) * 0.6 / (boxes.length + 0.6);
    const each = (height - 18 - top - haptics) / boxes.length;
    for (const [at, box] of boxes.entries()) drawCurve(c, this, Object.assign(box, { top: top + at * each + 5, height: each - 9 }));
    top = height - 18 - haptics + 4;
    if (other) {
      drawHaptics(c, this, run, { label: this.isNarrow ? "haptics" : "haptics, as recorded", top, height: haptics / 2 - 5 });
      drawHaptics(c, this, other, { label: this.isNarrow ? "compared" : `haptics, ${other.content.procedure}`, top: top + haptics / 2, height: haptics / 2 - 5, isHatched: true });
    } else drawHaptics(c, this, run, { label: this.isNarrow ? "haptics" : "haptics, as commanded", top, height: haptics - 6 });
    drawAxis(c, this, height - 4);
    this.draw();
  }

  /** Draw a lane per state; in a comparison its upper half is the recorded run, its lower the other. @param {CanvasRenderingContext2D} c */
  drawLanes(c) {
    this.states.forEach((_, row) => { c.fillStyle = row % 2 ? colors.panel : colors.raised; c.fillRect(this.left, row * LANE, this.width, LANE); });
    const height = this.other ? LANE / 2 - 1 : LANE - 3;
    this.drawSpans(c, this.run, 1.5, height);
    if (this.other) this.drawSpans(c, this.other, 1.5 + height + 0.5, height, true);
    return this.states.length * LANE + 3;
  }

  /** @param {CanvasRenderingContext2D} c @param {import("./run.js").Run} run @param {number} shift @param {number} height */
  drawSpans(c, run, shift, height, isHatched = false) {
    const own = new Map(this.states.map((state) => [state.name, state.color]));
    /** How far each lane is drawn. @type {number[]} */ const drawn = [];
    for (const [first, end, state] of run.spans) {
      const name = run.content.states[state], row = this.rows.get(name), span = this.span(first, end);
      if (!span || row === undefined || span[0] + span[1] - 0.5 < drawn[state]) continue;
      drawn[state] = span[0] + span[1];
      c.fillStyle = own.get(name) ?? colors.quiet;
      c.fillRect(span[0], row * LANE + shift, span[1], height);
      c.fillStyle = colors.quiet;  // because some states are as light as the page
      c.fillRect(span[0], row * LANE + shift + height - 0.5, span[1], 1);
      if (isHatched) hatch(c, span[0], row * LANE + shift, span[1], height);
    }
  }

  /** Return left and width of steps on the canvas; null if they are not in view. @param {number} first @param {number} end */
  span(first, end) {
    const { time_ms } = this.run;
    const start_ms = time_ms[first], stop_ms = end < time_ms.length ? time_ms[end] : time_ms[time_ms.length - 1];
    if (stop_ms < this.from_ms || start_ms > this.to_ms) return null;
    const left = Math.max(this.x(start_ms), this.left), right = Math.min(this.x(stop_ms), this.left + this.width);
    return [left, Math.max(right - left, 1.5)];
  }

  drawDifferences(/** @type {CanvasRenderingContext2D} */ c, /** @type {number} */ top) {
    drawLabel(c, this.isNarrow ? "differs" : "differs  ■ state  □ haptics only", top + 10);
    for (const [first, end, isState] of this.differences) {
      const span = this.span(first, end);
      if (!span) continue;
      c.fillStyle = c.strokeStyle = colors.text;
      if (isState) c.fillRect(span[0], top + 2, span[1], 9); else c.strokeRect(span[0] + 0.5, top + 2.5, span[1], 8);
    }
    return top + 14;
  }

  drawFaults(/** @type {CanvasRenderingContext2D} */ c, /** @type {number} */ top) {
    drawLabel(c, "faults", top + 10);
    c.fillStyle = colors.warn;
    for (const { first, last } of this.run.content.faults) {
      const span = this.span(first, last + 1);
      if (!span) continue;
      c.fillRect(span[0], top + 9, span[1], 2);
      c.beginPath();
      c.moveTo(span[0] - 4.5, top + 11); c.lineTo(span[0], top + 2); c.lineTo(span[0] + 4.5, top + 11);
      c.fill();
    }
    return top + 14;
  }

  draw() {
    const { context: c, run } = this;
    if (!run || !this.width) return;
    c.resetTransform();
    c.drawImage(this.background, 0, 0);
    const ratio = devicePixelRatio || 1, x = this.x(run.time_ms[this.number]);
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.font = "bold 13px " + getComputedStyle(document.body).fontFamily;
    c.fillStyle = colors.text; c.textAlign = "left";
    for (const { strip, top } of this.boxes) {
      const value = run.measure(strip.measure)[this.number];
      c.fillText(Number.isNaN(value) ? "–" : `${value.toFixed(strip.digits)} ${strip.unit}`, this.isNarrow ? 0 : 84, top + (this.isNarrow ? 25 : 10));
    }
    if (x < this.left - 1) return;
    c.fillRect(x - 0.75, 0, 1.5, this.canvas.clientHeight - 16);
    c.beginPath(); c.moveTo(x - 5, 0); c.lineTo(x + 5, 0); c.lineTo(x, 6); c.fill();
  }
}

/** @param {CanvasRenderingContext2D} c @param {string} text @param {number} y */
function drawLabel(c, text, y) { c.fillStyle = colors.quiet; c.textAlign = "left"; c.fillText(text, 0, y); }

/** Return the bounds of the procedure that the run is compared with, if they differ. @param {Bounds} other @param {Bounds} own */
function differing(other, own) {
  return [...other.bounds].sort().join() === [...own.bounds].sort().join() && other.band === own.band ? null : other;
}

/** Choose the top of a curve's scale: the whole run, up to ten times the bounds.
 *  @param {ArrayLike<number>} column @param {Strip} strip @param {number[]} more bounds, of another procedure */
function maxOf(column, strip, more) {
  let max = 0;
  for (let at = 0; at < column.length; at++) if (column[at] > max) max = column[at];
  return Math.max(Math.min(Math.max(max * 1.05, ...strip.bounds, 1e-6), strip.max * 5), ...more.map((bound) => bound * 1.05));
}
