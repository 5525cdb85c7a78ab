/** What a run amounts to, in a table; and its events, to jump to. */

import { sign } from "../server/signs.js";

const $ = (id) => document.getElementById(id);
const MOST_EVENTS = 500;
const KINDS = { all: "All", state: "States", fault: "Faults", difference: "Differences" };

/** Fill the table of measures; `other` is what another procedure makes of the run, or null. */
export function showMeasures(run, other) {
  const measures = [run.content.measures, ...(other ? [other.content.measures] : [])];
  const labels = new Map([...(other?.described ?? []), ...run.described].map((state) => [state.name, state.label]));
  const head = other ? [["", "recorded", other.content.procedure.replace(/\.toml$/, "")]] : [];
  const s = (value) => (value === null || value === undefined ? "–" : `${value.toFixed(2)} s`);
  const rows = [
    [measures[0].ends_in.replaceAll("_", " "), ...measures.map((m) => (m.completion_s === null ? (m.started_ms === null ? "no run" : "no") : "✓ yes"))],
    ["completion time", ...measures.map((m) => s(m.completion_s))],
    ["mean theta", ...measures.map((m) => (m.mean_theta_deg === null ? "–" : `${m.mean_theta_deg.toFixed(2)}°`))],
    ["unintended contacts", ...measures.map((m) => String(m.contacts))],
    ["state changes", ...measures.map((m) => String(m.changes))],
  ];
  const times = (title, key) => {
    const names = [...new Set(measures.flatMap((m) => Object.keys(m[key])))].sort((a, b) => (measures[0][key][b] ?? 0) - (measures[0][key][a] ?? 0));
    return names.length ? [[title], ...names.map((name) => [labels.get(name) ?? name, ...measures.map((m) => s(m[key][name] ?? 0))])] : [];
  };
  const kept = (claim) => (claim === undefined ? "–" : claim.broken ? `broken ${claim.broken} ×` : "kept");
  const names = [...new Set(measures.flatMap((m) => m.claims.map((claim) => claim.name)))];
  const claims = names.map((name) => [name, ...measures.map((m) => kept(m.claims.find((claim) => claim.name === name)))]);
  if (claims.length) claims.unshift(["claims about time"]);
  $("facts-head").replaceChildren(...head.map((cells) => line(cells, "th", cells.length)));
  $("facts").replaceChildren(...[...rows, ...times("in the run", "state_s"), ...times("in the whole recording", "all_state_s"), ...claims].map((cells) => line(cells, "td", measures.length + 1)));
}

function line(cells, kind, columns) {
  const row = document.createElement("tr");
  row.append(...cells.map((text) => Object.assign(document.createElement(kind), { textContent: text, title: kind === "th" ? text : "" })));
  if (cells.length === 1) { row.className = "group"; row.firstChild.colSpan = columns; }
  return row;
}

export class Events {
  /** @param {(number: number) => void} onJump */
  constructor(onJump) {
    this.onJump = onJump;
    this.all = [];
    $("which").append(...Object.entries(KINDS).map(([value, textContent]) => Object.assign(document.createElement("option"), { value, textContent })));
    $("which").addEventListener("change", () => this.fill());
  }

  begin(run, other, differences) {
    const label = (state) => [...run.described, ...(other?.described ?? [])].find((each) => each.name === state)?.label ?? state;
    const described = new Map(run.described.map((state) => [state.name, state]));
    this.run = run;
    this.all = run.spans.map(([first]) => ({ number: first, kind: "state", words: label(run.stateAt(first)), state: described.get(run.stateAt(first)) }));
    const { started_ms, ended_ms } = run.content.measures;
    if (started_ms !== null) this.all.push({ number: run.numberAt(started_ms + 1e-3), kind: "state", words: "run starts: tip inside the eye", mark: "→" });
    if (ended_ms !== null) this.all.push({ number: run.numberAt(ended_ms + 1e-3), kind: "state", words: "run ends: target hit", mark: "✓" });
    for (const { first, where, message } of run.content.faults) this.all.push({ number: first, kind: "fault", words: `${where}: ${message}`, mark: "▲" });
    for (const [first, , isState] of differences) {
      const words = isState ? `${label(other.stateAt(first))} instead of ${label(run.stateAt(first))}` : `feels ${other.playsAt(first)} instead of ${run.playsAt(first)}`;
      this.all.push({ number: first, kind: "difference", words, mark: "≠" });
    }
    if (differences.length) $("which").value = "difference";
    else if ($("which").value === "difference") $("which").value = "all";
    this.all.sort((a, b) => a.number - b.number);
    this.fill();
  }

  fill() {
    const wanted = $("which").value;
    this.shown = this.all.filter((event) => wanted === "all" || event.kind === wanted);
    const items = this.shown.slice(0, MOST_EVENTS).map((event) => this.item(event));
    if (this.shown.length > MOST_EVENTS) items.push(Object.assign(document.createElement("li"), { className: "quiet", textContent: `and ${this.shown.length - MOST_EVENTS} more` }));
    if (!items.length) items.push(Object.assign(document.createElement("li"), { className: "quiet", textContent: "none" }));
    $("events").replaceChildren(...items);
    this.current = -1;
  }

  item({ number, words, state, mark }) {
    const item = document.createElement("li"), button = Object.assign(document.createElement("button"), { type: "button" });
    const time = Object.assign(document.createElement("time"), { textContent: `${(this.run.time_ms[number] / 1000).toFixed(2)} s` });
    button.append(time, mark ? Object.assign(document.createElement("span"), { className: "mark", textContent: mark }) : signOf(state), words);
    button.addEventListener("click", () => this.onJump(number));
    item.append(button);
    return item;
  }

  /** Mark the last event before the step that is shown. */
  show(number) {
    let current = -1;
    while (current + 1 < Math.min(this.shown.length, MOST_EVENTS) && this.shown[current + 1].number <= number) current++;
    if (current === this.current) return;
    const items = $("events").children;
    items[this.current]?.classList.remove("now");
    this.current = current;
    items[current]?.classList.add("now");
    items[current]?.scrollIntoView({ block: "nearest" });
  }
}

function signOf(state) {
  const box = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  box.setAttribute("viewBox", "0 0 48 48");
  if (state) box.append(...sign(state));
  return box;
}
