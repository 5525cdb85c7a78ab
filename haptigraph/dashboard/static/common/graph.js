/** The scene graph with fixed positions: instruments left, anatomy right; relations appear and vanish between them. */

import { svg } from "./dom.js";

const TALL = { width: 460, row: 74, radius: 15, margins: [66, 84] };
const FLAT = { width: 620, row: 34, radius: 10, margins: [130, 150] };  // names on one line beside their circles
const GROUP_COLORS = ["#f6d58a", "#bcdcf2", "#cfe6c4", "#e3c9ea"];

export class Graph {
  /** @type {Map<string, { group: SVGGElement, text: SVGTextElement }>} */ pairs = new Map();
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
    for (const { subject, object } of relations) {
      const key = `${subject}>${object}`;
      if (!this.pairs.has(key)) this.pairs.set(key, drawEdge(position(subject), position(object), this.size.radius, this.pairs.size));
    }
    this.nodes = new Map(entities.map((entity) => [entity.name, drawNode(entity, position(entity.name), groups, this.size.radius)]));
    this.root.replaceChildren(arrowHead(), ...[...this.pairs.values()].map((pair) => pair.group), ...this.nodes.values());
  }

  show(/** @type {ImageHeader} */ header) {
    const content = JSON.stringify([header.nodes, header.edges, header.evidence]);
    if (content === this.shown) return;
    this.shown = content;
    for (const [name, element] of this.nodes) element.classList.toggle("there", header.nodes.includes(name));
    const evidence = new Set(header.evidence.map(String));
    for (const [key, { group, text }] of this.pairs) {
      const held = header.edges.filter(([subject, , object]) => `${subject}>${object}` === key);
      group.classList.toggle("holds", held.length > 0);
      group.classList.toggle("evidence", held.some((edge) => evidence.has(String(edge))));
      if (held.length) text.textContent = held.map(([, predicate]) => predicate.replaceAll("_", " ")).join(" · ");
    }
  }
}

/** Arrange groups in columns; a column's entities are ordered like those that relate to them.
 *  @param {Entity[]} entities @param {Relation[]} relations @param {string[]} groups @param {typeof TALL} size */
function layOut(entities, relations, groups, { width, row: rowHeight, margins }) {
  const positions = /** @type {Map<string, NodePosition>} */ (new Map());
  const longest = Math.max(...groups.map((group) => entities.filter((e) => e.group === group).length));
  const widest = Math.max(0, ...entities.filter((e) => e.group === groups.at(-1)).flatMap((e) => e.name.split("_").map((word) => word.length)));
  const right = Math.max(margins[1], 30 + 8.5 * widest);
  groups.forEach((group, column) => {
    const rank = (/** @type {Entity} */ { name }) => {
      const rows = relations.flatMap((r) => (r.object === name ? positions.get(r.subject)?.y ?? [] : []));
      return rows.length ? rows.reduce((a, b) => a + b) / rows.length : Infinity;
    };
    const members = entities.filter((entity) => entity.group === group);
    if (column) members.sort((a, b) => rank(a) - rank(b) || 0);
    const x = groups.length === 1 ? width / 2 : margins[0] + column * (width - margins[0] - right) / (groups.length - 1);
    members.forEach(({ name }, row) => positions.set(name, { x, y: rowHeight * longest * (row + 0.5) / members.length, isLeft: column === 0 }));
  });
  return positions;
}

/** @param {Entity} entity @param {NodePosition} position @param {string[]} groups @param {number} radius */
function drawNode(entity, { x, y, isLeft }, groups, radius) {
  const group = svg("g", { class: "entity" }, svg("circle", { cx: x, cy: y, r: radius }));
  group.style.setProperty("--own", GROUP_COLORS[groups.indexOf(entity.group) % GROUP_COLORS.length]);
  const words = entity.name.split("_");
  if (radius === FLAT.radius) {
    const beside = isLeft ? { x: x - radius - 7, "text-anchor": "end" } : { x: x + radius + 7, "text-anchor": "start" };
    group.append(svg("text", { ...beside, y: y + 5 }, words.join(" ")));
  } else if (isLeft) {
    group.append(svg("text", { x, y: y + radius + 17, "text-anchor": "middle" }, words.join(" ")));
  } else {
    group.append(...words.map((word, at) => svg("text", { x: x + radius + 7, y: y + 5 + (at - (words.length - 1) / 2) * 15 }, word)));
  }
  return group;
}

/** @param {NodePosition} from @param {NodePosition} to @param {number} radius @param {number} number */
function drawEdge(from, to, radius, number) {
  const dx = to.x - from.x, dy = to.y - from.y, length = Math.hypot(dx, dy) || 1;
  const cut = (radius + 3) / length;
  const start = [from.x + dx * cut, from.y + dy * cut], end = [to.x - dx * cut, to.y - dy * cut];
  const share = 0.5 + 0.12 * ((number % 3) - 1);  // so that labels of crossing edges do not overlap
  const isVertical = dx === 0;  // within a column: beside the arrow, clear of the names below its ends
  const text = svg("text", isVertical ? { x: from.x + 8, y: from.y + dy * 0.7, "text-anchor": "start" }
    : { x: from.x + dx * share, y: from.y + dy * share + 4, "text-anchor": "middle" });
  const group = svg("g", { class: "relation" }, svg("path", { d: `M${start}L${end}`, "marker-end": "url(#tip)" }), text);
  return { group, text };
}

/** Return the definition of an arrow head; the state diagram has one too. */
export function arrowHead(id = "tip", size = 12, orient = "auto") {
  const box = { viewBox: "0 0 10 10", refX: 8, refY: 5, markerWidth: size, markerHeight: size, markerUnits: "userSpaceOnUse" };
  return svg("defs", {}, svg("marker", { id, ...box, orient }, svg("path", { d: "M0 0 10 5 0 10z", class: "arrow-head" })));
}
