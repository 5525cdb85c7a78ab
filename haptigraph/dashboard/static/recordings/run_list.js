/** The list of recordings, a row each; their outcomes are requested once the list is there. */

import { $, make } from "../common/dom.js";
import { get, isAbort, messages } from "./stream.js";

const BATCH = 50;  // names in one request
const MEASURING = "…";

export class RunList {
  /** @type {string[]} */ procedures = [];
  /** The cells of outcome and length, by name. @type {Map<string, [outcome: HTMLElement, length: HTMLElement]>} */ cells = new Map();
  measuring = new AbortController();

  /** Load the list. */
  async load() {
    this.stop();
    $("folder").textContent = "reading the folder…";
    /** @type {RunListing} */ const listing = await (await get("/recordings/list", {})).json();
    this.procedures = listing.procedures;
    $("folder").textContent = listing.folder + (listing.left_out ? ` (and ${listing.left_out} older ones that are not listed)` : "");
    $("empty").hidden = listing.runs.length > 0;
    this.cells.clear();
    $("runs").replaceChildren(...listing.runs.map((run) => this.row(run)));
    await this.measure(listing.runs.filter((run) => !run.problem && !run.outcome && !run.is_being_written));
  }

  /** Stop measuring. */
  stop() { this.measuring.abort(); this.measuring = new AbortController(); }

  row(/** @type {RunRow} */ run) {
    if (run.problem) return make("tr", {}, cell(run.name), make("td", { textContent: run.problem, className: "problem", colSpan: 7 }));
    const note = run.is_being_written ? "still being recorded" : run.is_whole ? "" : `interrupted; repair it with haptigraph recover ${run.name}`;
    const link = make("a", { href: `#${encodeURIComponent(run.name)}`, textContent: run.name });
    const outcome = cell(run.is_being_written ? "" : MEASURING, "quiet");
    const length = cell(run.length_s === null ? "–" : seconds(run.length_s), "number");
    this.cells.set(run.name, [outcome, length]);
    if (run.outcome) this.showOutcome(run.outcome);
    return make("tr", {}, make("td", {}, link, note && make("small", { textContent: note })), cell(date(run.started_utc)), length,
      make("td", { textContent: run.source, title: run.source }), cell(run.procedure), cell(run.participant), cell(run.trial), outcome);
  }

  async measure(/** @type {RunRow[]} */ runs) {
    const { signal } = this.measuring;
    try {
      for (let first = 0; first < runs.length; first += BATCH) {
        const names = runs.slice(first, first + BATCH).map((run) => ["name", run.name]);
        for await (const [content] of messages("/recordings/outcomes", names, signal)) {
          if (content.type === "outcome") this.showOutcome(content);
        }
      }
      for (const { name } of runs) {
        const [outcome] = this.cells.get(name) ?? [];
        if (outcome?.textContent === MEASURING) Object.assign(outcome, { textContent: "open to see", title: "Large recordings are measured when they are opened." });
      }
    } catch (error) {
      if (!isAbort(error)) throw error;
    }
  }

  showOutcome(/** @type {Outcome} */ { name, problem, completion_s, started_ms, ends_in, length_s }) {
    const [outcome, length] = this.cells.get(name) ?? [];
    if (!outcome || !length) return;
    if (problem) { Object.assign(outcome, { textContent: "cannot be read completely", title: problem, className: "problem" }); return; }
    const goal = ends_in.replaceAll("_", " ");
    outcome.textContent = completion_s !== null ? `✓ ${goal} after ${completion_s.toFixed(1)} s` : started_ms === null ? "– no run" : `✗ no ${goal}`;
    outcome.className = completion_s !== null ? "" : "quiet";
    length.textContent = seconds(length_s);
  }
}

/** Format a duration. @param {number} value [s] */
export function seconds(value) {
  return value < 60 ? `${value.toFixed(1)} s` : `${Math.floor(value / 60)} min ${Math.floor(value % 60).toString().padStart(2, "0")} s`;
}

/** Format a date and time, in local time. @param {string} utc */
export function date(utc) {
  const at = new Date(utc), two = (/** @type {number} */ number) => String(number).padStart(2, "0");
  return Number.isNaN(at.getTime()) ? "" : `${at.getFullYear()}-${two(at.getMonth() + 1)}-${two(at.getDate())} ${two(at.getHours())}:${two(at.getMinutes())}`;
}

function cell(/** @type {string} */ textContent, className = "") { return make("td", { textContent, className }); }
