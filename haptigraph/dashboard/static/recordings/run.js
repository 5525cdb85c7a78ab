/** A recorded run as this page knows it: columns of numbers, and how to draw its states. Draws nothing. */

import { columnsOf } from "./frames.js";

export class Run {
  /** @param {any} content of a frame "timeline" or "comparison" @param {Uint8Array} bytes its columns */
  constructor(content, bytes) {
    this.content = content;
    this.columns = columnsOf(content, bytes);
    this.time_ms = this.columns.time_ms;
    this.length = this.time_ms.length;
    this.end_ms = this.time_ms[this.length - 1];
    this.spans = spansOf(this.columns.state);
    this.described = content.hello?.procedure.states ?? content.described;
  }

  measure(name) { return this.columns[`measure:${name}`]; }
  stateAt(number) { return this.content.states[this.columns.state[number]]; }
  playsAt(number) { return this.content.patterns[this.columns.plays[number]]; }

  /** Return the step that is shown at a moment: the last one before it. */
  numberAt(time_ms) { return Math.max(firstAfter(this.time_ms, time_ms) - 1, 0); }
}

/** Return where runs differ: [first, end, whether the state does or only the touch]. */
export function differencesOf(run, other) {
  const found = [];
  for (let number = 0; number < Math.min(run.length, other.length); number++) {
    const state = run.stateAt(number) !== other.stateAt(number);
    if (!state && run.playsAt(number) === other.playsAt(number)) continue;
    const last = found.at(-1);
    if (last && last[1] === number && last[2] === state) last[1] = number + 1;
    else found.push([number, number + 1, state]);
  }
  return found;
}

/** Return the first place in a sorted column that is greater than a value. */
export function firstAfter(column, value) {
  let low = 0, high = column.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (column[middle] > value) high = middle; else low = middle + 1;
  }
  return low;
}

/** Return stretches of one value: [first, end, value]. */
function spansOf(column) {
  const spans = [];
  for (let number = 0; number < column.length; number++) {
    if (number === 0 || column[number] !== column[number - 1]) spans.push([number, number + 1, column[number]]);
    else spans[spans.length - 1][1] = number + 1;
  }
  return spans;
}
