/** The summary of a run: a table of its measures, and a list of its events. */

import { $, make } from "../common/dom.js";
import { icon } from "../common/icons.js";

const MAX_EVENTS = 500;
const KINDS = { all: "All", state: "States", fault: "Faults", difference: "Differences" };

/** Fill the table of measures. @param {RecordedRun} run @param {ComparedRun | null} other the run under another procedure */
export function showMeasures(run, other) {
  const measures = [run.content.measures, ...(other ? [other.content.measures] : [])];
  const head = other ? [["measure", "recorded", other.content.procedure.replace(/\.toml$/, "")]] : [];
  const seconds = (/** @type {number | null} */ value) => (value === null ? "–" : `${value.toFixed(2)} s`);
  const rows = [
    [measures[0].ends_in.replaceAll("_", " "), ...measures.map((m) => (m.completion_s === null ? (m.started_ms === null ? "no run" : "no") : "✓ yes"))],
    ["completion time", ...measures.map((m) => seconds(m.completion_s))],
    ["mean theta", ...measures.map((m) => (m.mean_theta_deg === null ? "–" : `${m.mean_theta_deg.toFixed(2)}°`))],
    ["unintended contacts", ...measures.map((m) => String(m.contacts))],
    ["state changes", ...measures.map((m) => String(m.changes))],
    ["tip not visible", ...measures.map((m) => (m.tipless_steps ? `${(100 * m.tipless_steps / m.steps).toFixed(1)} %, up to ${m.longest_tipless_s.toFixed(2)} s` : "never"))],
  ];
  const times = (/** @type {string} */ title, /** @type {"state_s" | "all_state_s"} */ key) => {
    const names = [...new Set(measures.flatMap((m) => Object.keys(m[key])))].sort((a, b) => (measures[0][key][b] ?? 0) - (measures[0][key][a] ?? 0));
    return names.length ? [[title], ...names.map((name) => [run.labelOf(name, other), ...measures.map((m) => seconds(m[key][name] ?? 0))])] : [];
  };
  const names = [...new Set(measures.flatMap((m) => m.claims.map((claim) => claim.name)))];
  const claims = names.map((name) => [name, ...measures.map((m) => {
    const claim = m.claims.find((each) => each.name === name);
    return claim === undefined ? "–" : claim.broken ? `broken ${claim.broken} ×` : claim.cases ? "kept" : "not exercised";
  })]);
  if (claims.length) claims.unshift(["claims about time"]);
  const body = [...rows, ...times("in the run", "state_s"), ...times("in the whole recording", "all_state_s"), ...claims];
  $("measures-head").replaceChildren(...head.map((cells) => make("tr", {}, ...cells.map((text) => make("th", { textContent: text.replaceAll("_", "_\u200b"), title: text })))));
  $("measures").replaceChildren(...body.map((cells) => (cells.length === 1
    ? make("tr", { className: "group" }, make("td", { textContent: cells[0], colSpan: measures.length + 1 }))
    : make("tr", {}, ...cells.map((textContent) => make("td", { textContent }))))));
}

export class Events {
  /** @type {RunEvent[]} */ all = [];
  /** @type {RunEvent[]} */ shown = [];
  /** @type {RecordedRun} */ run;
  current = -1;

  constructor(/** @type {(number: number) => void} */ onJump) {
    this.onJump = onJump;
    $("which").append(...Object.entries(KINDS).map(([value, textContent]) => make("option", { value, textContent })));
    $("which").addEventListener("change", () => this.fill());
  }

  begin(/** @type {RecordedRun} */ run, /** @type {ComparedRun | null} */ other, /** @type {Difference[]} */ differences) {
    const label = (/** @type {string} */ name) => run.labelOf(name, other);
    const states = new Map(run.states.map((state) => [state.name, state]));
    this.run = run;
    this.all = run.spans.map(([first]) => ({ number: first, kind: "state", text: label(run.stateAt(first)), state: states.get(run.stateAt(first)) }));
    const { started_ms, ended_ms } = run.content.measures;
    if (started_ms !== null) this.all.push({ number: run.numberAt(started_ms + 1e-3), kind: "state", text: "run starts: tip inside the eye", mark: "→" });
    if (ended_ms !== null) this.all.push({ number: run.numberAt(ended_ms + 1e-3), kind: "state", text: "run ends: target hit", mark: "✓" });
    for (const { first, last, where, message, ended } of run.content.faults) {
      this.all.push({ number: first, kind: "fault", text: `${where}: ${message}`, mark: "▲" });
      if (ended) this.all.push({ number: Math.min(last + 1, run.length - 1), kind: "fault", text: `${where}: ${ended}`, mark: "✓" });
    }
    for (const [first, , isState] of other ? differences : []) {
      const names = isState ? [label(other?.stateAt(first) ?? ""), label(run.stateAt(first))] : [`feels ${other?.patternAt(first)}`, run.patternAt(first)];
      this.all.push({ number: first, kind: "difference", text: names.join(" instead of "), mark: "≠" });
    }
    if (differences.length) $("which").value = "difference";
    else if ($("which").value === "difference") $("which").value = "all";
    this.all.sort((a, b) => a.number - b.number);
    this.fill();
  }

  fill() {
    const kind = $("which").value;
    this.shown = this.all.filter((event) => kind === "all" || event.kind === kind);
    const items = this.shown.slice(0, MAX_EVENTS).map((event) => this.item(event));
    if (this.shown.length > MAX_EVENTS) items.push(make("li", { className: "quiet", textContent: `and ${this.shown.length - MAX_EVENTS} more` }));
    if (!items.length) items.push(make("li", { className: "quiet", textContent: "none" }));
    $("events").replaceChildren(...items);
    this.current = -1;
  }

  item(/** @type {RunEvent} */ { number, text, state, mark }) {
    const time = make("time", { textContent: `${(this.run.time_ms[number] / 1000).toFixed(2)} s` });
    const button = make("button", { type: "button" }, time, mark ? make("span", { className: "mark", textContent: mark }) : icon(state), text);
    button.addEventListener("click", () => this.onJump(number));
    return make("li", {}, button);
  }

  /** Mark the last event before the step that is shown. @param {number} number */
  show(number) {
    let current = -1;
    while (current + 1 < Math.min(this.shown.length, MAX_EVENTS) && this.shown[current + 1].number <= number) current++;
    if (current === this.current) return;
    const items = $("events").children;
    items[this.current]?.classList.remove("now");
    this.current = current;
    items[current]?.classList.add("now");
    if (items[current]) scrollInside($("events"), items[current]);
  }
}

/** Scroll a list, not the page, until an item is visible. @param {HTMLElement} list @param {Element} item */
function scrollInside(list, item) {
  const shown = list.getBoundingClientRect(), at = item.getBoundingClientRect();
  list.scrollTop += Math.min(at.top - shown.top, 0) + Math.max(at.bottom - shown.bottom, 0);
}
