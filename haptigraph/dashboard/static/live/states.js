/** The state diagram: misaligned left, aligned right, the others between; the current one lit, ways taken drawn. */

import { sign, svg } from "../server/signs.js";

const WIDTH = 480, BOX = { width: 226, height: 44 }, GAP = 20;

export class Diagram {
  /** @param {SVGSVGElement} root */
  constructor(root) { this.root = root; }

  begin(procedure) {
    this.current = "";
    this.ways = new Map();
    // Every state is connected to the one of not seeing; only ways between the others say something.
    this.walks = new Set(procedure.states.filter((state) => state.sign !== "lost").map((state) => state.name));
    const rows = rowsOf(procedure.states);
    const top = 20, height = top + rows.length * (BOX.height + GAP);
    this.root.setAttribute("viewBox", `0 0 ${WIDTH} ${height}`);
    this.layer = svg("g");
    this.nodes = new Map();
    this.places = new Map();
    const columns = procedure.states.some((state) => state.column !== "middle")
      ? [heading("misaligned", WIDTH * 0.25), heading("aligned", WIDTH * 0.75)] : [];
    this.root.replaceChildren(arrowHead(), ...columns, this.layer);
    rows.forEach((row, number) => row.forEach(([state, x]) => {
      const y = top + number * (BOX.height + GAP);
      const node = box(state, x, y);
      this.places.set(state.name, { x, y: y + BOX.height / 2 });
      this.nodes.set(state.name, node);
      this.root.append(node);
    }));
  }

  show(name) {
    if (name === this.current) return;
    this.nodes.get(this.current)?.classList.remove("on");
    this.nodes.get(name)?.classList.add("on");
    if (this.walks.has(this.current) && this.walks.has(name)) this.walk(this.current, name);
    this.current = name;
  }

  walk(from, to) {
    const key = `${from}>${to}`;
    if (!this.ways.has(key)) {
      this.ways.set(key, way(this.places.get(from), this.places.get(to)));
      this.layer.append(this.ways.get(key));
    }
    for (const [other, path] of this.ways) path.classList.toggle("last", other === key);
  }
}

/** Arrange states: rows of [state, centre x]; low priorities first, so that a procedure runs downwards. */
function rowsOf(states) {
  const late = (a, b) => b.priority - a.priority;
  const left = states.filter((s) => s.column === "left").sort(late);
  const right = states.filter((s) => s.column === "right").sort(late);
  const middle = states.filter((s) => s.column === "middle").sort(late);
  const first = Math.min(...[...left, ...right].map((s) => s.priority));
  const beside = (pair) => pair.map((state, at) => [state, pair.length === 1 ? WIDTH / 2 : WIDTH * (0.25 + 0.5 * at)]);
  const pairs = (list) => list.length ? [beside(list.slice(0, 2)), ...pairs(list.slice(2))] : [];
  const unknown = middle.filter((s) => s.sign === "lost"), others = middle.filter((s) => s.sign !== "lost");
  const columns = Array.from({ length: Math.max(left.length, right.length) }, (_, at) => [
    ...(left[at] ? [[left[at], WIDTH * 0.25]] : []), ...(right[at] ? [[right[at], WIDTH * 0.75]] : [])]);
  const before = others.filter((s) => s.priority > first);
  const after = others.filter((s) => !(s.priority > first)).sort((a, b) => a.priority - b.priority);
  return [...pairs(before), ...columns, ...pairs(after), ...pairs(unknown)];
}

function box(state, x, y) {
  const node = svg("g", { class: "node", transform: `translate(${x - BOX.width / 2} ${y})` },
    svg("title", {}, document.createTextNode(`${state.label}: priority ${state.priority}, feels ${state.feel}`)),
    svg("rect", { width: BOX.width, height: BOX.height, rx: 9 }));
  node.style.setProperty("--own", state.color);
  node.style.setProperty("--ink", state.ink);
  const mark = svg("g", { transform: `translate(10 ${BOX.height / 2 - 11}) scale(.46)` }, ...sign(state));
  const backing = svg("circle", { cx: 24, cy: 24, r: 27, fill: "#161d23" });
  mark.prepend(backing);
  const lines = broken(state.label);
  const words = lines.map((line, at) => svg("text", { x: 42, y: BOX.height / 2 + 5 + (at - (lines.length - 1) / 2) * 16 }, line));
  const number = svg("text", { class: "dim", x: BOX.width - 10, y: BOX.height / 2 + 5, "text-anchor": "end" }, String(state.priority));
  node.append(mark, ...words, number);
  return node;
}

function broken(label) {
  if (label.length <= 22) return [label];
  const words = label.split(" ");
  const half = words.findIndex((_, at) => words.slice(0, at + 1).join(" ").length > label.length / 2 - 2) + 1;
  return [words.slice(0, half).join(" "), words.slice(half).join(" ")].filter(Boolean);
}

function heading(words, x) { return svg("text", { class: "heading", x, y: 14, "text-anchor": "middle" }, words); }

function arrowHead() {
  return svg("defs", {}, svg("marker", { id: "head", viewBox: "0 0 10 10", refX: 8, refY: 5, markerWidth: 11, markerHeight: 11, markerUnits: "userSpaceOnUse", orient: "auto-start-reverse" },
    svg("path", { d: "M0 0 10 5 0 10z", fill: "#9aabb8" })));
}

function way(from, to) {
  const dx = to.x - from.x, dy = to.y - from.y;
  const sideways = Math.abs(dx) > BOX.width / 2;
  const start = sideways ? [from.x + Math.sign(dx) * BOX.width / 2, from.y] : [from.x, from.y + Math.sign(dy) * BOX.height / 2];
  const end = sideways ? [to.x - Math.sign(dx) * BOX.width / 2, to.y] : [to.x, to.y - Math.sign(dy) * BOX.height / 2];
  const shift = (dx + dy > 0 ? 1 : -1) * 7;  // there and back are two lines
  const bend = sideways ? [(start[0] + end[0]) / 2, (start[1] + end[1]) / 2 + shift] : [(start[0] + end[0]) / 2 + shift * (Math.abs(dy) > 80 ? 4 : 1), (start[1] + end[1]) / 2];
  return svg("path", { class: "way", "marker-end": "url(#head)", d: `M${start} Q${bend} ${end}` });
}
