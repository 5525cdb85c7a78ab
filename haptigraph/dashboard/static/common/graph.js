/** The scene graph with fixed positions: instruments left, anatomy right; relations appear and vanish between them. */

import { svg } from "./dom.js";

const TALL = { width: 460, row: 74, radius: 15, margins: [66, 84] };
const FLAT = { width: 620, row: 34, radius: 10, margins: [130, 150] };  // names on one line beside their circles
const BENDS = [0, 0.15, -0.15, 0.3, -0.3];  // of an edge, as shares of its length; the first that touches no other node is taken
const SHARES = [0.5, 0.42, 0.58, 0.34, 0.66, 0.26, 0.74];  // places of a label along its edge; the first without overlap is taken
const BULGE = 38;  // of an edge within a column, away from its names
const LINE = 15, LETTER = 8;  // about a name's height and width
const GROUP_COLORS = ["#f6d58a", "#bcdcf2", "#cfe6c4", "#e3c9ea"];

export class Graph {
  /** @type {Map<string, Edge>} */ pairs = new Map();
  /** @type {Box[]} */ boxes = [];
  /** @type {Map<string, SVGGElement>} */ nodes = new Map();
  shown = "";

  /** @param {SVGSVGElement} root @param {boolean} [isFlat] layout for a box that is much wider than high */
  constructor(root, isFlat = false) { this.root = root; this.size = isFlat ? FLAT : TALL; }

  begin(/** @type {Procedure} */ { entities, relations }) {
    this.shown = "";
    const groups = [...new Set(entities.map((entity) => entity.group))];
    const positions = layOut(entities, relations, groups, this.size);
    const position = (/** @type {string} */ name) => /** @type {NodePosition} */ (positions.get(name));
    const height = Math.max(...[...positions.values()].map(({ y }) => y)) + this.size.row / 2;
    this.root.setAttribute("viewBox", `0 0 ${this.size.width} ${height}`);
    this.pairs.clear();
    const boxes = new Map(entities.map(({ name }) => [name, boxesOf(name, position(name), this.size)]));
    this.boxes = [...boxes.values()].flat();
    for (const { subject, object } of relations) {
      const key = `${subject}>${object}`;
      if (!this.pairs.has(key)) {
        const others = [...boxes].flatMap(([name, own]) => (name === subject || name === object ? [] : own));
        this.pairs.set(key, drawEdge(position(subject), position(object), this.size.radius, others));
      }
    }
    this.nodes = new Map(entities.map((entity) => [entity.name, drawNode(entity, position(entity.name), groups, this.size)]));
    this.root.replaceChildren(arrowHead(), ...[...this.pairs.values()].map((pair) => pair.group), ...this.nodes.values());
  }

  show(/** @type {ImageHeader} */ header) {
    const content = JSON.stringify([header.nodes, header.edges, header.evidence]);
    if (content === this.shown) return;
    this.shown = content;
    for (const [name, element] of this.nodes) element.classList.toggle("there", header.nodes.includes(name));
    const evidence = new Set(header.evidence.map(String));
    const taken = [...this.boxes];
    for (const [key, { group, text, curve }] of this.pairs) {
      const held = header.edges.filter(([subject, , object]) => `${subject}>${object}` === key);
      group.classList.toggle("holds", held.length > 0);
      group.classList.toggle("evidence", held.some((edge) => evidence.has(String(edge))));
      if (!held.length) continue;
      text.textContent = held.map(([, predicate]) => predicate.replaceAll("_", " ")).join(" · ");
      taken.push(place(text, curve, taken));
    }
  }
}

/** Arrange groups in columns; a column's entities are ordered like those that relate to them.
 *  @param {Entity[]} entities @param {Relation[]} relations @param {string[]} groups @param {typeof TALL} size */
function layOut(entities, relations, groups, { width, row: rowHeight, margins }) {
  const positions = /** @type {Map<string, NodePosition>} */ (new Map());
  const longest = Math.max(...groups.map((group) => entities.filter((e) => e.group === group).length));
  const widest = (/** @type {string | undefined} */ group) => Math.max(0, ...entities.filter((e) => e.group === group).flatMap((e) => e.name.split("_").map((word) => word.length)));
  const left = Math.max(margins[0], 30 + 8.5 * widest(groups[0])), right = Math.max(margins[1], 30 + 8.5 * widest(groups.at(-1)));
  groups.forEach((group, column) => {
    const rank = (/** @type {Entity} */ { name }) => {
      const rows = relations.flatMap((r) => (r.object === name ? positions.get(r.subject)?.y ?? [] : []));
      return rows.length ? rows.reduce((a, b) => a + b) / rows.length : Infinity;
    };
    const members = entities.filter((entity) => entity.group === group);
    if (column) members.sort((a, b) => rank(a) - rank(b) || 0);
    const x = groups.length === 1 ? width / 2 : left + column * (width - left - right) / (groups.length - 1);
    members.forEach(({ name }, row) => positions.set(name, { x, y: rowHeight * longest * (row + 0.5) / members.length, isLeft: column === 0 }));
  });
  return positions;
}

/** Return where a node and its name are; names are at the outer side of the first column, else right of their circles.
 *  @param {string} name @param {NodePosition} position @param {typeof TALL} size @returns {Box[]} */
function boxesOf(name, { x, y, isLeft }, { radius }) {
  const lines = linesOf(name, radius), width = LETTER * Math.max(...lines.map((line) => line.length)) + 7;
  const text = { left: isLeft ? x - radius - width : x + radius, width, top: y - lines.length * LINE / 2, height: lines.length * LINE };
  return [{ left: x - radius, width: 2 * radius, top: y - radius, height: 2 * radius }, text];
}

/** @param {string} name @param {number} radius */
function linesOf(name, radius) { const words = name.split("_"); return radius === FLAT.radius ? [words.join(" ")] : words; }

/** @param {Entity} entity @param {NodePosition} position @param {string[]} groups @param {typeof TALL} size */
function drawNode(entity, { x, y, isLeft }, groups, { radius }) {
  const group = svg("g", { class: "entity" }, svg("circle", { cx: x, cy: y, r: radius }));
  group.style.setProperty("--own", GROUP_COLORS[groups.indexOf(entity.group) % GROUP_COLORS.length]);
  const beside = isLeft ? { x: x - radius - 7, "text-anchor": "end" } : { x: x + radius + 7, "text-anchor": "start" };
  const lines = linesOf(entity.name, radius);
  group.append(...lines.map((line, at) => svg("text", { ...beside, y: y + 5 + (at - (lines.length - 1) / 2) * LINE }, line)));
  return group;
}

/** @param {NodePosition} from @param {NodePosition} to @param {number} radius @param {Box[]} others nodes to pass by @returns {Edge} */
function drawEdge(from, to, radius, others) {
  const length = Math.hypot(to.x - from.x, to.y - from.y) || 1;
  const hits = (/** @type {number} */ bend) => {
    const curve = curveOf(from, to, bend);
    return SAMPLES.filter((share) => others.some((box) => isIn(curve(share), box))).length;
  };
  const bend = from.x === to.x ? (from.isLeft ? -2 : 2) * BULGE / (to.y - from.y) : BENDS.reduce((best, other) => (hits(other) < hits(best) ? other : best));
  const curve = curveOf(from, to, bend), cut = (radius + 3) / length;
  const steps = Array.from({ length: 21 }, (_, at) => curve(cut + (1 - 2 * cut) * at / 20));
  const text = svg("text", { "text-anchor": "middle" });
  const group = svg("g", { class: "relation" }, svg("path", { d: `M${steps.map(({ x, y }) => `${x.toFixed(1)},${y.toFixed(1)}`).join("L")}`, "marker-end": "url(#tip)" }), text);
  return { group, text, curve };
}

const SAMPLES = Array.from({ length: 41 }, (_, at) => at / 40);

/** Return a quadratic curve between two nodes. @param {NodePosition} from @param {NodePosition} to @param {number} bend */
function curveOf(from, to, bend) {
  const dx = to.x - from.x, dy = to.y - from.y;
  const control = { x: (from.x + to.x) / 2 - bend * dy, y: (from.y + to.y) / 2 + bend * dx };
  return (/** @type {number} */ share) => {
    const at = (/** @type {"x" | "y"} */ axis) => (1 - share) ** 2 * from[axis] + 2 * share * (1 - share) * control[axis] + share ** 2 * to[axis];
    return { x: at("x"), y: at("y") };
  };
}

/** Place a label on its edge where it overlaps least; return its box.
 *  @param {SVGTextElement} text @param {Edge["curve"]} curve @param {Box[]} taken @returns {Box} */
function place(text, curve, taken) {
  const { width, height } = text.getBBox();
  const places = SHARES.map((share) => {
    const { x, y } = curve(share), box = { left: x - width / 2, width, top: y - height / 2, height };
    return { x, y, box, overlap: taken.reduce((sum, other) => sum + overlapOf(box, other), 0) };
  });
  const best = places.reduce((one, other) => (other.overlap < one.overlap ? other : one));
  text.setAttribute("x", String(best.x));
  text.setAttribute("y", String(best.y + 4));
  return best.box;
}

/** @param {{ x: number, y: number }} point @param {Box} box */
function isIn({ x, y }, { left, width, top, height }) { return x > left && x < left + width && y > top && y < top + height; }

/** Return the area that two boxes share. @param {Box} one @param {Box} other */
function overlapOf(one, other) {
  const width = Math.min(one.left + one.width, other.left + other.width) - Math.max(one.left, other.left);
  const height = Math.min(one.top + one.height, other.top + other.height) - Math.max(one.top, other.top);
  return Math.max(width, 0) * Math.max(height, 0);
}

/** Return the definition of an arrow head; the state diagram has one too. */
export function arrowHead(id = "tip", size = 12, orient = "auto") {
  const box = { viewBox: "0 0 10 10", refX: 8, refY: 5, markerWidth: size, markerHeight: size, markerUnits: "userSpaceOnUse" };
  return svg("defs", {}, svg("marker", { id, ...box, orient }, svg("path", { d: "M0 0 10 5 0 10z", class: "arrow-head" })));
}
