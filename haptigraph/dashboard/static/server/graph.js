/** The scene graph at fixed places: instruments left, anatomy right; relations appear and vanish between them. */

import { svg } from "./signs.js";

const TALL = { width: 460, row: 74, radius: 15, margins: [66, 84] };
const FLAT = { width: 620, row: 34, radius: 10, margins: [130, 150] };  // names in one line beside their circles
const GROUP_COLORS = ["#f6d58a", "#bcdcf2", "#cfe6c4", "#e3c9ea"];

export class Graph {
  /**
   * @param {SVGSVGElement} root
   * @param {boolean} isFlat draws it for a place that is much wider than high
   */
  constructor(root, isFlat = false) { this.root = root; this.shown = ""; this.size = isFlat ? FLAT : TALL; }

  begin({ entities, relations }) {
    this.shown = "";
    const groups = [...new Set(entities.map((entity) => entity.group))];
    const places = placesOf(entities, relations, groups, this.size);
    const height = Math.max(...[...places.values()].map((place) => place.y)) + this.size.row / 2;
    this.root.setAttribute("viewBox", `0 0 ${this.size.width} ${height}`);
    this.pairs = new Map();
    for (const relation of relations) {
      const key = `${relation.subject}>${relation.object}`;
      if (!this.pairs.has(key)) this.pairs.set(key, edge(places.get(relation.subject), places.get(relation.object), this.size.radius, this.pairs.size));
    }
    this.nodes = new Map(entities.map((entity) => [entity.name, node(entity, places.get(entity.name), groups, this.size)]));
    this.root.replaceChildren(head(), ...[...this.pairs.values()].map((pair) => pair.group), ...this.nodes.values());
  }

  show(header) {
    const now = JSON.stringify([header.nodes, header.edges, header.evidence]);
    if (now === this.shown) return;
    this.shown = now;
    for (const [name, element] of this.nodes) element.classList.toggle("there", header.nodes.includes(name));
    const reasons = new Set(header.evidence.map(String));
    for (const [key, { group, words }] of this.pairs) {
      const held = header.edges.filter(([subject, , object]) => `${subject}>${object}` === key);
      group.classList.toggle("holds", held.length > 0);
      group.classList.toggle("evidence", held.some((edge) => reasons.has(String(edge))));
      if (held.length) words.textContent = held.map(([, predicate]) => predicate.replaceAll("_", " ")).join(" · ");
    }
  }
}

/** Put groups into columns; a column's entities stand in the order of those that relate to them. */
function placesOf(entities, relations, groups, { width, row: high, margins }) {
  const places = new Map();
  const longest = Math.max(...groups.map((group) => entities.filter((e) => e.group === group).length));
  const widest = Math.max(0, ...entities.filter((e) => e.group === groups.at(-1)).flatMap((e) => e.name.split("_").map((word) => word.length)));
  const right = Math.max(margins[1], 30 + 8.5 * widest);
  groups.forEach((group, column) => {
    const rank = (entity) => {
      const rows = relations.filter((r) => r.object === entity.name && places.has(r.subject)).map((r) => places.get(r.subject).y);
      return rows.length ? rows.reduce((a, b) => a + b) / rows.length : Infinity;
    };
    const members = entities.filter((entity) => entity.group === group);
    if (column) members.sort((a, b) => rank(a) - rank(b) || 0);
    const x = groups.length === 1 ? width / 2 : margins[0] + column * (width - margins[0] - right) / (groups.length - 1);
    members.forEach((entity, row) => {
      const y = high * longest * (row + 0.5) / members.length;
      places.set(entity.name, { x, y, isLeft: column === 0 });
    });
  });
  return places;
}

function node(entity, place, groups, { radius }) {
  const group = svg("g", { class: "entity" }, svg("circle", { cx: place.x, cy: place.y, r: radius }));
  group.style.setProperty("--own", GROUP_COLORS[groups.indexOf(entity.group) % GROUP_COLORS.length]);
  const words = entity.name.split("_");
  if (radius === FLAT.radius) {
    const beside = place.isLeft ? { x: place.x - radius - 7, "text-anchor": "end" } : { x: place.x + radius + 7 };
    group.append(svg("text", { ...beside, y: place.y + 5 }, words.join(" ")));
  } else if (place.isLeft) {
    group.append(svg("text", { x: place.x, y: place.y + radius + 17, "text-anchor": "middle" }, words.join(" ")));
  } else {
    words.forEach((word, at) => group.append(
      svg("text", { x: place.x + radius + 7, y: place.y + 5 + (at - (words.length - 1) / 2) * 15 }, word)));
  }
  return group;
}

function edge(from, to, radius, number) {
  const dx = to.x - from.x, dy = to.y - from.y, length = Math.hypot(dx, dy) || 1;
  const cut = (radius + 3) / length;
  const start = [from.x + dx * cut, from.y + dy * cut], end = [to.x - dx * cut, to.y - dy * cut];
  const share = 0.5 + 0.12 * ((number % 3) - 1);  // labels of crossing edges stand apart
  const within = dx === 0;  // a column: beside the arrow, clear of the names below its ends
  const words = svg("text", within ? { x: from.x + 8, y: from.y + dy * 0.7, "text-anchor": "start" }
    : { x: from.x + dx * share, y: from.y + dy * share + 4, "text-anchor": "middle" });
  const group = svg("g", { class: "relation" }, svg("path", { d: `M${start}L${end}`, "marker-end": "url(#tip)" }), words);
  return { group, words };
}

function head() {
  return svg("defs", {}, svg("marker", { id: "tip", viewBox: "0 0 10 10", refX: 8, refY: 5, markerWidth: 12, markerHeight: 12, markerUnits: "userSpaceOnUse", orient: "auto" },
    svg("path", { d: "M0 0 10 5 0 10z", fill: "#9aabb8" })));
}
