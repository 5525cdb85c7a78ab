/** The list of recordings: one line each; whether the target was hit is asked for when the rest is there. */

import { asked, frames } from "./frames.js";

const BATCH = 50;  // names in one request
const $ = (id) => document.getElementById(id);

export class RunList {
  constructor() {
    this.procedures = [];
    this.asking = new AbortController();
  }

  /** Ask the server what is there. */
  async load() {
    this.stop();
    const found = await (await asked("/recordings/list", {})).json();
    this.procedures = found.procedures;
    $("folder").textContent = found.folder + (found.left_out ? ` (and ${found.left_out} older ones that are not listed)` : "");
    $("empty").hidden = found.runs.length > 0;
    this.cells = new Map();
    $("runs").replaceChildren(...found.runs.map((run) => this.row(run)));
    await this.measure(found.runs.filter((run) => !run.problem && !run.outcome && !run.is_being_written));
  }

  /** Ask for no more. */
  stop() { this.asking.abort(); this.asking = new AbortController(); }

  row(run) {
    const row = document.createElement("tr");
    if (run.problem) {
      const problem = cell(run.problem, "problem");
      problem.colSpan = 7;
      row.append(cell(run.name), problem);
      return row;
    }
    const name = cell("");
    name.append(Object.assign(document.createElement("a"), { href: `#${encodeURIComponent(run.name)}`, textContent: run.name }));
    if (run.is_being_written) name.append(small("still being recorded"));
    else if (!run.is_whole) name.append(small(`interrupted; haptigraph recover ${run.name} makes it whole`));
    const target = cell(run.is_being_written ? "" : "…", "quiet");
    const length = cell(run.length_s === null ? "–" : seconds(run.length_s), "number");
    this.cells.set(run.name, [target, length]);
    const source = cell(run.source);
    source.title = run.source;
    row.append(name, cell(date(run.started_utc)), length, source, cell(run.procedure), cell(run.participant), cell(run.trial), target);
    if (run.outcome) this.tell(run.outcome, run.name);
    return row;
  }

  async measure(runs) {
    if (!runs.length) return;
    const { signal } = this.asking;
    try {
      for (let first = 0; first < runs.length; first += BATCH) {
        const names = runs.slice(first, first + BATCH).map((run) => ["name", run.name]);
        for await (const [content] of frames("/recordings/outcomes", names, signal)) {
          if (content.type === "outcome") this.tell(content, content.name);
        }
      }
      for (const { name } of runs) {
        const [target] = this.cells.get(name);
        if (target.textContent === "…") { target.textContent = "open to see"; target.title = "Large recordings are read when they are opened."; }
      }
    } catch (error) {
      if (error.name !== "AbortError") throw error;
    }
  }

  tell(outcome, name) {
    const [target, length] = this.cells.get(name);
    if (outcome.problem) { Object.assign(target, { textContent: "cannot be read whole", title: outcome.problem, className: "problem" }); return; }
    const isOver = outcome.completion_s !== null, goal = outcome.ends_in.replaceAll("_", " ");
    target.textContent = isOver ? `✓ ${goal} after ${outcome.completion_s.toFixed(1)} s` : outcome.started_ms === null ? "– no run" : `✗ no ${goal}`;
    target.className = isOver ? "" : "quiet";
    length.textContent = seconds(outcome.length_s);
  }
}

/** Say a duration. */
export function seconds(value) {
  return value < 60 ? `${value.toFixed(1)} s` : `${Math.floor(value / 60)} min ${Math.floor(value % 60).toString().padStart(2, "0")} s`;
}

/** Say a date and time in this place's time. */
export function date(utc) {
  const at = new Date(utc);
  return Number.isNaN(at.getTime()) ? "" : `${at.getFullYear()}-${two(at.getMonth() + 1)}-${two(at.getDate())} ${two(at.getHours())}:${two(at.getMinutes())}`;
}

function two(number) { return String(number).padStart(2, "0"); }
function cell(text, className = "") { return Object.assign(document.createElement("td"), { textContent: text, className }); }
function small(text) { return Object.assign(document.createElement("small"), { textContent: text }); }
