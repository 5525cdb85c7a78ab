/** Curves of a recorded run on a canvas. Of many steps in one column of pixels, least and most are kept. */

import { firstAfter } from "./run.js";

const INK = "#e8edf1", QUIET = "#9aabb8", FAINT = "#2c3740", GAP_MS = 300;

/** Draw a measure: its curve, and the bounds that the procedure decides by. */
export function drawCurve(c, timeline, { strip, top, height }) {
  const { run, x, room } = timeline, left = x(timeline.from_ms);
  const y = (value) => top + height * (1 - Math.min(Math.max((value - strip.least) / (strip.most - strip.least), 0), 1));
  c.fillStyle = "#5cc48422";
  if (strip.band) c.fillRect(left, y(strip.band), room, y(0) - y(strip.band));
  c.lineWidth = 1; c.strokeStyle = FAINT; c.textAlign = "right";
  strip.bounds.forEach((bound, at) => {
    c.beginPath(); c.moveTo(left, y(bound)); c.lineTo(left + room, y(bound)); c.stroke();
    c.fillStyle = QUIET;
    if (!strip.bounds.slice(0, at).some((other) => Math.abs(y(other) - y(bound)) < 11)) c.fillText(`${bound} ${strip.unit}`, left - 5, y(bound) + 4);
  });
  c.fillStyle = QUIET; c.textAlign = "left";
  c.fillText(strip.words, 0, top + 10);
  c.strokeStyle = INK; c.lineWidth = 1.4; c.lineJoin = "round";
  c.beginPath();
  for (const [moves, px, value] of points(run.time_ms, run.measure(strip.measure), timeline)) c[moves ? "moveTo" : "lineTo"](px, y(value));
  c.stroke();
}

/** Return [whether a gap stands before it, x, value]: every step, or first, least, most and last of every column. */
function points(time_ms, values, { x, from_ms, to_ms, room }) {
  const first = Math.max(firstAfter(time_ms, from_ms) - 1, 0), end = Math.min(firstAfter(time_ms, to_ms) + 1, time_ms.length);
  const isThin = end - first < 2 * room, left = x(from_ms), right = left + room, scale = room / (to_ms - from_ms), found = [];
  let before_ms = -Infinity, column = null;
  for (let number = first; number < end; number++) {
    const value = values[number], at_ms = time_ms[number];
    if (value !== value) continue;  // nan
    const px = Math.min(Math.max(left + (at_ms - from_ms) * scale, left), right), gap = at_ms - before_ms > GAP_MS;
    before_ms = at_ms;
    if (isThin) { found.push([gap, px, value]); continue; }
    // Where a whole gap is less than a pixel it does not break the line.
    if (column && Math.floor(px) === column.px) {
      if (value < column.least) column.least = value;
      if (value > column.most) column.most = value;
      column.last = value;
      continue;
    }
    if (column) found.push(...ends(column));
    column = { px: Math.floor(px), gap, first: value, least: value, most: value, last: value };
  }
  if (column) found.push(...ends(column));
  return found;
}

function ends({ px, gap, first, least, most, last }) {
  return [[gap, px, first], [false, px, least], [false, px, most], [false, px, last]];
}

/** Draw the touch as it was commanded. */
export function drawTouch(c, timeline, top, height) {
  const { run, x, from_ms, to_ms, room } = timeline, { edge_ms, edge_amplitude } = run.columns;
  const left = x(from_ms), right = left + room;
  c.fillStyle = QUIET; c.textAlign = "left";
  c.fillText("touch, as commanded", 0, top + 10);
  c.strokeStyle = FAINT; c.lineWidth = 1;
  c.beginPath(); c.moveTo(left, top + height + 0.5); c.lineTo(right, top + height + 0.5); c.stroke();
  c.fillStyle = "#f0a546";
  let drawn = -1, drawnAmplitude = 0;
  for (let at = Math.max(firstAfter(edge_ms, from_ms) - 1, 0); at < edge_ms.length && edge_ms[at] <= to_ms; at++) {
    const amplitude = edge_amplitude[at];
    if (!amplitude) continue;
    const start = Math.max(x(edge_ms[at]), left), end = Math.min(at + 1 < edge_ms.length ? x(edge_ms[at + 1]) : x(run.end_ms), right);
    if (end - drawn < 0.5 && amplitude <= drawnAmplitude) continue;  // less than a pixel, and beneath what is there
    [drawn, drawnAmplitude] = [Math.max(end, start + 1), amplitude];
    if (end > left) c.fillRect(start, top + height * (1 - amplitude), Math.max(end - start, 1), height * amplitude);
  }
}

/** Draw the time: about ten marks at round numbers. */
export function drawAxis(c, { x, from_ms, to_ms }, bottom) {
  const wanted = (to_ms - from_ms) / 10_000;
  const step_s = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 1200, 3600].find((each) => each >= wanted) ?? 7200;
  const digits = step_s >= 1 ? 0 : step_s >= 0.1 ? 1 : 2;
  c.fillStyle = QUIET; c.textAlign = "center";
  for (let at = Math.ceil(from_ms / 1000 / step_s); at * step_s * 1000 <= to_ms; at++) {
    const time_s = at * step_s;
    const text = time_s < 60 || step_s < 1 ? `${time_s.toFixed(digits)} s` : `${Math.floor(time_s / 60)}:${String(Math.round(time_s % 60)).padStart(2, "0")} min`;
    c.fillText(text, Math.min(x(time_s * 1000), x(to_ms) - 8), bottom);
    c.fillRect(x(time_s * 1000), bottom - 14, 1, 3);
  }
}
