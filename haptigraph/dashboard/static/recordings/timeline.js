/** One run over time: a lane per state, differences, faults, distance, angle, touch; and the moment that is shown.
 *  What stands still is drawn once into a second canvas, so that moving the cursor costs nothing. */

import { drawAxis, drawCurve, drawTouch } from "./curves.js";
import { differencesOf } from "./run.js";
import { sign } from "../server/signs.js";
import { stripsOf } from "../server/traces.js";

export const LEFT = 244, RIGHT = 14, LANE = 14;
const QUIET = "#9aabb8", PANEL = "#161d23", NARROWEST_MS = 400;

export class Timeline {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {HTMLElement} lanes takes the names of the states
   * @param {(time_ms: number) => void} onSeek told when a moment is chosen
   */
  constructor(canvas, lanes, onSeek) {
    Object.assign(this, { canvas, lanes, onSeek, run: null, other: null });
    this.context = canvas.getContext("2d", { alpha: false });
    this.still = new OffscreenCanvas(1, 1);
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); this.seek(event); });
    canvas.addEventListener("pointermove", (event) => { if (event.buttons) this.seek(event); });
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    new ResizeObserver(() => this.redraw()).observe(canvas);
  }

  begin(run) {
    this.run = run;
    this.number = 0;
    [this.from_ms, this.to_ms] = [0, Math.max(run.end_ms, 1)];
    this.strips = stripsOf(run.content.hello.procedure.relations).map((strip) => ({ ...strip, most: mostOf(run.measure(strip.measure), strip) }));
    this.compare(null);
  }

  /** Lay another procedure's states beside the recorded ones; null: none. */
  compare(other) {
    this.other = other;
    this.differences = other ? differencesOf(this.run, other) : [];
    const described = [...this.run.described].reverse();
    const known = new Set(described.map((state) => state.name));
    if (other) described.push(...other.described.filter((state) => !known.has(state.name)));
    this.states = described;
    this.row = new Map(described.map((state, row) => [state.name, row]));
    this.lanes.replaceChildren(...described.map(named));
    this.redraw();
    this.show(this.number);
  }

  show(number) {
    this.number = number;
    const state = this.run.stateAt(number);
    [...this.lanes.children].forEach((item, row) => item.classList.toggle("on", this.row.get(state) === row));
    const time_ms = this.run.time_ms[number], span_ms = this.to_ms - this.from_ms;
    if (time_ms < this.from_ms || time_ms > this.to_ms) this.look(time_ms - span_ms / 2, span_ms);
    this.draw();
  }

  /** Show more (factor > 1) or less of the run about a moment. */
  zoom(factor, about_ms = this.run.time_ms[this.number]) {
    const span_ms = Math.max((this.to_ms - this.from_ms) * factor, NARROWEST_MS);
    const share = (about_ms - this.from_ms) / (this.to_ms - this.from_ms);
    this.look(about_ms - share * span_ms, span_ms);
  }

  look(from_ms, span_ms) {
    const end_ms = Math.max(this.run.end_ms, 1), width_ms = Math.min(span_ms, end_ms);
    this.from_ms = Math.min(Math.max(from_ms, 0), end_ms - width_ms);
    this.to_ms = this.from_ms + width_ms;
    cancelAnimationFrame(this.waiting);  // a wheel turns faster than a long run is drawn
    this.waiting = requestAnimationFrame(() => this.redraw());
  }

  wheel(event) {
    if (!this.run) return;
    event.preventDefault();
    const span_ms = this.to_ms - this.from_ms;
    if (Math.abs(event.deltaX) > Math.abs(event.deltaY) || event.shiftKey) this.look(this.from_ms + (event.deltaX || event.deltaY) / 800 * span_ms, span_ms);
    else this.zoom(Math.exp(event.deltaY / 500), this.timeAt(event));
  }

  seek(event) { if (this.run) this.onSeek(this.timeAt(event)); }

  timeAt(event) {
    const share = (event.clientX - this.canvas.getBoundingClientRect().left - LEFT) / this.room;
    return this.from_ms + Math.min(Math.max(share, 0), 1) * (this.to_ms - this.from_ms);
  }

  /** Draw all that stands still, then the cursor. */
  redraw() {
    const ratio = devicePixelRatio || 1, width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    if (!this.run || !width) return;
    this.room = width - LEFT - RIGHT;
    for (const each of [this.canvas, this.still]) Object.assign(each, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    const c = this.still.getContext("2d", { alpha: false });
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.font = "12px " + getComputedStyle(document.body).fontFamily;
    c.fillStyle = PANEL;
    c.fillRect(0, 0, width, height);
    this.x = (time_ms) => LEFT + (time_ms - this.from_ms) / (this.to_ms - this.from_ms) * this.room;
    let top = this.drawLanes(c);
    if (this.other) top = this.drawDifferences(c, top);
    if (this.run.content.faults.length) top = this.drawFaults(c, top);
    const each = (height - 18 - top) / (this.strips.length + 0.6);
    this.places = this.strips.map((strip, at) => ({ strip, top: top + at * each + 5, height: each - 9 }));
    for (const place of this.places) drawCurve(c, this, place);
    drawTouch(c, this, top + this.strips.length * each + 4, each * 0.6 - 6);
    drawAxis(c, this, height - 4);
    this.draw();
  }

  /** Draw when each state held; with another procedure the upper half is the recorded one, the lower the other. */
  drawLanes(c) {
    this.states.forEach((_, row) => { c.fillStyle = row % 2 ? PANEL : "#1b232a"; c.fillRect(LEFT, row * LANE, this.room, LANE); });
    const height = this.other ? LANE / 2 - 1 : LANE - 3;
    this.drawSpans(c, this.run, 1.5, height);
    if (this.other) this.drawSpans(c, this.other, 1.5 + height + 0.5, height, true);
    return this.states.length * LANE + 3;
  }

  drawSpans(c, run, shift, height, isHatched = false) {
    const colors = new Map(this.states.map((state) => [state.name, state.color]));
    const drawn = [];  // how far each lane is
    for (const [first, end, state] of run.spans) {
      const name = run.content.states[state];
      const place = this.place(first, end);
      if (!place || place[0] + place[1] - 0.5 < drawn[state]) continue;
      drawn[state] = place[0] + place[1];
      c.fillStyle = colors.get(name) ?? QUIET;
      c.fillRect(place[0], this.row.get(name) * LANE + shift, place[1], height);
      if (isHatched) hatch(c, place[0], this.row.get(name) * LANE + shift, place[1], height);
    }
  }

  /** Return left and width of steps on the canvas; null if they are not in view. */
  place(first, end) {
    const { time_ms } = this.run;
    const start = time_ms[first], stop = end < time_ms.length ? time_ms[end] : time_ms[time_ms.length - 1];
    if (stop < this.from_ms || start > this.to_ms) return null;
    const left = Math.max(this.x(start), LEFT), right = Math.min(this.x(stop), LEFT + this.room);
    return [left, Math.max(right - left, 1.5)];
  }

  drawDifferences(c, top) {
    this.words(c, "differs  ■ state  □ touch only", top + 10);
    for (const [first, end, isState] of this.differences) {
      const place = this.place(first, end);
      if (!place) continue;
      c.fillStyle = c.strokeStyle = "#fff";
      if (isState) c.fillRect(place[0], top + 2, place[1], 9); else c.strokeRect(place[0] + 0.5, top + 2.5, place[1], 8);
    }
    return top + 14;
  }

  drawFaults(c, top) {
    this.words(c, "faults", top + 10);
    c.fillStyle = "#f0a546";
    for (const { first, last } of this.run.content.faults) {
      const place = this.place(first, last + 1);
      if (!place) continue;
      c.fillRect(place[0], top + 9, place[1], 2);
      c.beginPath();
      c.moveTo(place[0] - 4.5, top + 11); c.lineTo(place[0], top + 2); c.lineTo(place[0] + 4.5, top + 11);
      c.fill();
    }
    return top + 14;
  }

  words(c, text, y) { c.fillStyle = QUIET; c.textAlign = "left"; c.fillText(text, 0, y); }

  draw() {
    const { context: c, run } = this;
    if (!run || !this.x) return;
    c.resetTransform();
    c.drawImage(this.still, 0, 0);
    const ratio = devicePixelRatio || 1, x = this.x(run.time_ms[this.number]);
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.font = "bold 13px " + getComputedStyle(document.body).fontFamily;
    c.fillStyle = "#e8edf1"; c.textAlign = "left";
    for (const { strip, top } of this.places) {
      const value = run.measure(strip.measure)[this.number];
      c.fillText(Number.isNaN(value) ? "–" : `${value.toFixed(strip.digits)} ${strip.unit}`, 84, top + 10);
    }
    if (x < LEFT - 1) return;
    c.fillRect(x - 0.75, 0, 1.5, this.canvas.clientHeight - 16);
    c.beginPath(); c.moveTo(x - 5, 0); c.lineTo(x + 5, 0); c.lineTo(x, 6); c.fill();
  }
}

function named(state) {
  const item = document.createElement("li"), box = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  box.setAttribute("viewBox", "0 0 48 48");
  box.append(...sign(state));
  item.append(box, state.label);
  return item;
}

function hatch(c, left, top, width, height) {
  c.save();
  c.beginPath(); c.rect(left, top, width, height); c.clip();
  c.strokeStyle = "#0008"; c.lineWidth = 1.5; c.beginPath();
  for (let x = left - height; x < left + width; x += 4) { c.moveTo(x, top + height); c.lineTo(x + height, top); }
  c.stroke();
  c.restore();
}

/** Choose the top of a curve's scale: all of the run, but not more than ten times what is decided by. */
function mostOf(column, strip) {
  let most = 0;
  for (const value of column) if (value > most) most = value;
  return Math.min(Math.max(most * 1.05, ...strip.bounds, 1e-6), strip.most * 5);
}
