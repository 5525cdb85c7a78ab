/** A recorded run as columns of numbers, and the descriptions of its states. */

import { columnsOf } from "./stream.js";

/** @template {RunContent} [T=RunContent] */
export class Run {
  /** @param {T} content of a timeline or a comparison @param {Uint8Array<ArrayBuffer>} bytes its columns @param {StateDescription[]} states */
  constructor(content, bytes, states) {
    this.content = content;
    this.columns = columnsOf(content, bytes);
    this.states = states;
    this.time_ms = this.columns.time_ms;
    this.length = this.time_ms.length;
    this.end_ms = this.time_ms[this.length - 1];
    this.spans = spansOf(this.columns.state);
  }

  measure(/** @type {string} */ name) { return this.columns[`measure:${name}`]; }
  stateAt(/** @type {number} */ number) { return this.content.states[this.columns.state[number]]; }
  /** Return the label of a state that either run may have. @param {string} name @param {Run | null} [other] */
  labelOf(name, other) { return [...this.states, ...(other?.states ?? [])].find((each) => each.name === name)?.label ?? name; }
  patternAt(/** @type {number} */ number) { return this.content.patterns[this.columns.plays[number]]; }

  /** Return what had failed at a step. @param {number} number */
  faultsAt(number) {
    const seconds = (/** @type {number} */ first) => (first < number ? `, since ${(this.time_ms[first] / 1000).toFixed(2)} s` : "");
    return this.content.faults.filter(({ first, last }) => first <= number && number <= last).map(({ first, where, message }) => `${where}: ${message}${seconds(first)}`);
  }

  /** Return the step that is shown at a time: the last one before it. @param {number} time_ms */
  numberAt(time_ms) { return Math.max(firstAfter(this.time_ms, time_ms) - 1, 0); }
}

/** Return the steps in which runs differ. @param {Run} run @param {Run} other */
export function differencesOf(run, other) {
  const found = /** @type {Difference[]} */ ([]);
  for (let number = 0; number < Math.min(run.length, other.length); number++) {
    const isState = run.stateAt(number) !== other.stateAt(number);
    if (!isState && run.patternAt(number) === other.patternAt(number)) continue;
    const last = found.at(-1);
    if (last && last[1] === number && last[2] === isState) last[1] = number + 1;
    else found.push([number, number + 1, isState]);
  }
  return found;
}

/** Return the index of the first value of a sorted column that is greater than a value. @param {ArrayLike<number>} column @param {number} value */
export function firstAfter(column, value) {
  let low = 0, high = column.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (column[middle] > value) high = middle; else low = middle + 1;
  }
  return low;
}

/** Return the stretches of equal values, end excluded. @param {ArrayLike<number>} column */
function spansOf(column) {
  const spans = /** @type {[first: number, end: number, value: number][]} */ ([]);
  for (let number = 0; number < column.length; number++) {
    if (number === 0 || column[number] !== column[number - 1]) spans.push([number, number + 1, column[number]]);
    else spans[spans.length - 1][1] = number + 1;
  }
  return spans;
}
