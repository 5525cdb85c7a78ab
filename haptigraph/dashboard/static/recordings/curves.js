/** Curves of a recorded run on a canvas; where several steps share a column of pixels, its extremes are drawn. */

import { colors } from "../theme/colors.js";
import { firstAfter } from "./run.js";
import { drawBounds } from "../common/strips.js";

const MAX_GAP_MS = 300;
const TICKS_S = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 1200, 3600];

/** @typedef {import("./timeline.js").Timeline} Timeline */

/** Draw a measure with its bounds. @param {CanvasRenderingContext2D} c @param {Timeline} timeline @param {StripBox} box */
export function drawCurve(c, timeline, { strip, compared, top, height }) {
  const { run, width } = timeline, left = timeline.x(timeline.from_ms);
  c.textAlign = "right";
  const y = drawBounds(c, strip, { left, width, top, height }, (text, bound_y) => c.fillText(`${text} ${strip.unit}`, left - 5, bound_y + 4));
  if (compared) drawCompared(c, timeline, strip, compared, y);
  c.fillStyle = colors.quiet; c.textAlign = "left";
  c.fillText(strip.label, 0, top + 10);
  c.strokeStyle = colors.text; c.lineWidth = 1.4; c.lineJoin = "round";
  c.beginPath();
  for (const [isStart, x, value] of points(run.time_ms, run.measure(strip.measure), timeline)) c[isStart ? "moveTo" : "lineTo"](x, y(value));
  c.stroke();
}

/** Draw the bounds of the procedure that the run is compared with: dashed, with its name, and its band hatched.
 *  @param {CanvasRenderingContext2D} c @param {Timeline} timeline @param {Strip} strip @param {Bounds} compared @param {(value: number) => number} y */
function drawCompared(c, timeline, strip, { bounds, band }, y) {
  const left = timeline.x(timeline.from_ms), right = left + timeline.width, name = timeline.other?.content.procedure ?? "";
  c.globalAlpha = 0.3;
  if (band && band !== strip.band) hatch(c, left, y(band), timeline.width, y(0) - y(band), colors.good);
  c.globalAlpha = 1;
  c.strokeStyle = c.fillStyle = colors.quiet; c.lineWidth = 1; c.textAlign = "right";
  c.setLineDash([5, 4]);
  for (const bound of bounds.filter((each) => !strip.bounds.includes(each))) {
    c.beginPath(); c.moveTo(left, y(bound)); c.lineTo(right, y(bound)); c.stroke();
    c.fillText(`${bound} ${strip.unit}${timeline.isNarrow ? "" : `, ${name}`}`, right - 4, y(bound) - 3);
  }
  c.setLineDash([]);
}

/** Return the points of a curve, and whether each starts a line: every step, or first, extremes and last of every column.
 *  @param {ArrayLike<number>} time_ms @param {ArrayLike<number>} values @param {Timeline} timeline */
function points(time_ms, values, timeline) {
  const { from_ms, to_ms, width } = timeline;
  const first = Math.max(firstAfter(time_ms, from_ms) - 1, 0), end = Math.min(firstAfter(time_ms, to_ms) + 1, time_ms.length);
  const isSparse = end - first < 2 * width, left = timeline.x(from_ms), right = left + width, scale = width / (to_ms - from_ms);
  const found = /** @type {[isStart: boolean, x: number, value: number][]} */ ([]);
  /** @type {PixelColumn | null} */ let column = null;
  let before_ms = -Infinity;
  for (let number = first; number < end; number++) {
    const value = values[number], at_ms = time_ms[number];
    if (Number.isNaN(value)) continue;
    const x = Math.min(Math.max(left + (at_ms - from_ms) * scale, left), right), isStart = at_ms - before_ms > MAX_GAP_MS;
    before_ms = at_ms;
    if (isSparse) { found.push([isStart, x, value]); continue; }
    // A gap within a column of pixels does not interrupt the line.
    if (column && Math.floor(x) === column.x) {
      if (value < column.min) column.min = value;
      if (value > column.max) column.max = value;
      column.last = value;
      continue;
    }
    if (column) found.push(...pointsOf(column));
    column = { x: Math.floor(x), isStart, first: value, min: value, max: value, last: value };
  }
  if (column) found.push(...pointsOf(column));
  return found;
}

/** @param {PixelColumn} column @returns {[boolean, number, number][]} */
function pointsOf({ x, isStart, first, min, max, last }) {
  return [[isStart, x, first], [false, x, min], [false, x, max], [false, x, last]];
}

/** Draw the haptic level that was commanded, or would have been.
 *  @param {CanvasRenderingContext2D} c @param {Timeline} timeline @param {RecordedRun | ComparedRun} run
 *  @param {{ label: string, top: number, height: number, isHatched?: boolean }} lane */
export function drawHaptics(c, timeline, run, { label, top, height, isHatched = false }) {
  const { from_ms, to_ms, width } = timeline, { edge_ms, edge_amplitude } = run.columns;
  const left = timeline.x(from_ms), right = left + width;
  c.fillStyle = colors.quiet; c.textAlign = "left";
  c.fillText(label, 0, top + 10, left - 8);
  c.strokeStyle = colors.line; c.lineWidth = 1;
  c.beginPath(); c.moveTo(left, top + height + 0.5); c.lineTo(right, top + height + 0.5); c.stroke();
  c.fillStyle = colors.warn;
  let drawn = -1, drawnAmplitude = 0;
  for (let at = Math.max(firstAfter(edge_ms, from_ms) - 1, 0); at < edge_ms.length && edge_ms[at] <= to_ms; at++) {
    const amplitude = edge_amplitude[at];
    if (!amplitude) continue;
    const start = Math.max(timeline.x(edge_ms[at]), left);
    const end = Math.min(timeline.x(at + 1 < edge_ms.length ? edge_ms[at + 1] : run.end_ms), right);
    if (end - drawn < 0.5 && amplitude <= drawnAmplitude) continue;  // less than a pixel, and hidden
    [drawn, drawnAmplitude] = [Math.max(end, start + 1), amplitude];
    if (end <= left) continue;
    c.fillRect(start, top + height * (1 - amplitude), Math.max(end - start, 1), height * amplitude);
    if (isHatched) hatch(c, start, top + height * (1 - amplitude), Math.max(end - start, 1), height * amplitude);
  }
}

/** Hatch a rectangle, as what belongs to the compared procedure.
 *  @param {CanvasRenderingContext2D} c @param {number} left @param {number} top @param {number} width @param {number} height */
export function hatch(c, left, top, width, height, color = "#0008") {
  c.save();
  c.beginPath(); c.rect(left, top, width, height); c.clip();
  c.strokeStyle = color; c.lineWidth = 1.5; c.beginPath();
  for (let x = left - height; x < left + width; x += 4) { c.moveTo(x, top + height); c.lineTo(x + height, top); }
  c.stroke();
  c.restore();
}

/** Draw the time axis: about ten ticks at round numbers. @param {CanvasRenderingContext2D} c @param {Timeline} timeline @param {number} bottom */
export function drawAxis(c, timeline, bottom) {
  const { from_ms, to_ms } = timeline;
  const tick_s = TICKS_S.find((each) => each >= (to_ms - from_ms) / 10_000) ?? 7200;
  const digits = tick_s >= 1 ? 0 : tick_s >= 0.1 ? 1 : 2;
  c.fillStyle = colors.quiet; c.textAlign = "center";
  for (let at = Math.ceil(from_ms / 1000 / tick_s); at * tick_s * 1000 <= to_ms; at++) {
    const time_s = at * tick_s, x = timeline.x(time_s * 1000);
    const text = time_s < 60 || tick_s < 1 ? `${time_s.toFixed(digits)} s` : `${Math.floor(time_s / 60)}:${String(Math.round(time_s % 60)).padStart(2, "0")} min`;
    c.fillText(text, Math.min(x, timeline.x(to_ms) - 8), bottom);
    c.fillRect(x, bottom - 14, 1, 3);
  }
}
