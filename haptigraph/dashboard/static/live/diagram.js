/** The state diagram: misaligned states left, aligned ones right, others between; it marks the current state and past transitions. */

import { svg } from "../common/dom.js";
import { arrowHead } from "../common/graph.js";
import { iconShapes } from "../common/icons.js";

const WIDTH = 480, BOX = { width: 226, height: 44 }, GAP = 20, MAX_LABEL = 22;

export class Diagram {
  /** @type {Map<string, SVGGElement>} */ nodes = new Map();
  /** @type {Map<string, [x: number, y: number]>} */ places = new Map();
  /** @type {Map<string, SVGPathElement>} */ transitions = new Map();
  layer = svg("g");
  current = "";

  constructor(/** @type {SVGSVGElement} */ root) { this.root = root; }

  begin(/** @type {Procedure} */ { states }) {
    this.current = "";
    for (const map of [this.transitions, this.nodes, this.places]) map.clear();
    // Every state leads to and from those without a tip; only transitions between the others are informative.
    this.known = new Set(states.filter((state) => hasTip(state)).map((state) => state.name));
    const rows = rowsOf(states), top = 20;
    this.root.setAttribute("viewBox", `0 0 ${WIDTH} ${top + rows.length * (BOX.height + GAP)}`);
    this.layer = svg("g");
    const headings = states.some((state) => state.column !== "middle") ? ["misaligned", "aligned"] : [];
    const columns = headings.map((text, at) => svg("text", { class: "heading", x: WIDTH * (0.25 + 0.5 * at), y: 14, "text-anchor": "middle" }, text));
    this.root.replaceChildren(arrowHead("head", 11, "auto-start-reverse"), ...columns, this.layer);
    rows.forEach((row, number) => row.forEach(([state, x]) => {
      const y = top + number * (BOX.height + GAP);
      const node = drawState(state, x, y);
      this.places.set(state.name, [x, y + BOX.height / 2]);
      this.nodes.set(state.name, node);
      this.root.append(node);
    }));
  }

  /** @param {string} name of a state */
  show(name) {
    if (name === this.current) return;
    this.nodes.get(this.current)?.classList.remove("on");
    this.nodes.get(name)?.classList.add("on");
    if (this.known?.has(this.current) && this.known.has(name)) this.mark(this.current, name);
    this.current = name;
  }

  /** Mark a transition. @param {string} from @param {string} to */
  mark(from, to) {
    const key = `${from}>${to}`, start = this.places.get(from), end = this.places.get(to);
    if (!this.transitions.has(key) && start && end) {
      const path = drawTransition(start, end);
      this.transitions.set(key, path);
      this.layer.append(path);
    }
    for (const [other, path] of this.transitions) path.classList.toggle("last", other === key);
  }
}

/** Arrange states in rows, low priorities first, so that a procedure runs downwards. @param {StateDescription[]} states */
function rowsOf(states) {
  /** @typedef {[state: StateDescription, x: number][]} Row @typedef {(a: StateDescription, b: StateDescription) => number} Order */
  /** @type {Order} */ const descending = (a, b) => b.priority - a.priority;
  const inColumn = (/** @type {string} */ column) => states.filter((s) => s.column === column).sort(descending);
  const left = inColumn("left"), right = inColumn("right"), middle = inColumn("middle");
  const first = Math.min(...[...left, ...right].map((s) => s.priority));
  /** @returns {Row[]} */ const pairs = (/** @type {StateDescription[]} */ list) => list.flatMap((_, at) => {
    const pair = list.slice(at, at + 2);
    return at % 2 ? [] : [pair.map((state, side) => [state, pair.length === 1 ? WIDTH / 2 : WIDTH * (0.25 + 0.5 * side)])];
  });
  const others = middle.filter(hasTip), tipless = middle.filter((s) => !hasTip(s)).reverse();
  /** @type {Row[]} */ const columns = Array.from({ length: Math.max(left.length, right.length) }, (_, at) => [
    .../** @type {Row} */ (left[at] ? [[left[at], WIDTH * 0.25]] : []), .../** @type {Row} */ (right[at] ? [[right[at], WIDTH * 0.75]] : [])]);
  const before = others.filter((s) => s.priority > first);
  const after = others.filter((s) => !(s.priority > first)).sort((a, b) => a.priority - b.priority);
  return [...pairs(before), ...columns, ...pairs(after), ...pairs(tipless)];
}

function hasTip(/** @type {StateDescription} */ { icon }) { return icon !== "lost" && icon !== "tipless"; }

function drawState(/** @type {StateDescription} */ state, /** @type {number} */ x, /** @type {number} */ y) {
  const node = svg("g", { class: "node", transform: `translate(${x - BOX.width / 2} ${y})` },
    svg("title", {}, `${state.label}: priority ${state.priority}, feels ${state.feel}`),
    svg("rect", { width: BOX.width, height: BOX.height, rx: 9 }));
  node.style.setProperty("--own", state.color);
  node.style.setProperty("--ink", state.ink);
  const backing = svg("circle", { cx: 24, cy: 24, r: 27, class: "backing" });
  const icon = svg("g", { transform: `translate(10 ${BOX.height / 2 - 11}) scale(.46)` }, backing, ...iconShapes(state));
  const lines = broken(state.label);
  const texts = lines.map((line, at) => svg("text", { x: 38, y: BOX.height / 2 + 5 + (at - (lines.length - 1) / 2) * 16 }, line));
  const number = svg("text", { class: "dim", x: BOX.width - 7, y: BOX.height / 2 + 5, "text-anchor": "end" }, String(state.priority));
  node.append(icon, ...texts, number);
  return node;
}

/** Break a label into at most two lines. @param {string} label */
function broken(label) {
  if (label.length <= MAX_LABEL) return [label];
  const words = label.split(" ");
  const half = words.findIndex((_, at) => words.slice(0, at + 1).join(" ").length > label.length / 2 - 2) + 1;
  return [words.slice(0, half).join(" "), words.slice(half).join(" ")].filter(Boolean);
}

function drawTransition(/** @type {number[]} */ [fromX, fromY], /** @type {number[]} */ [toX, toY]) {
  const dx = toX - fromX, dy = toY - fromY;
  const isSideways = Math.abs(dx) > BOX.width / 2;
  const start = isSideways ? [fromX + Math.sign(dx) * BOX.width / 2, fromY] : [fromX, fromY + Math.sign(dy) * BOX.height / 2];
  const end = isSideways ? [toX - Math.sign(dx) * BOX.width / 2, toY] : [toX, toY - Math.sign(dy) * BOX.height / 2];
  const shift = (dx + dy > 0 ? 1 : -1) * 7;  // so that both directions are visible
  const x = (start[0] + end[0]) / 2, y = (start[1] + end[1]) / 2;
  const bend = isSideways ? [x, y + shift] : [x + shift * (Math.abs(dy) > 80 ? 4 : 1), y];
  return svg("path", { class: "transition", "marker-end": "url(#head)", d: `M${start} Q${bend} ${end}` });
}
