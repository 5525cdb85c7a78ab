/** The eye as the surgeon sees it, and over it what was found and where relations hold. */

import { toggle } from "./signs.js";
import { ring, zoneOf } from "./zones.js";

const OVERLAYS = { needle: "Instrument", cone: "Cone", zone: "Zones", target: "Target" };
const LINE = "#8fb4d3";

export class View {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {HTMLElement | null} fieldset takes the switches of the overlays; null: there are none
   */
  constructor(canvas, fieldset) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    /** Which overlays are drawn, by name. */
    this.shows = {};
    this.picture = this.header = this.hello = null;
    this.waiting = null;  // the newest message while another is being decoded
    this.decoding = false;
    /** Called with the header of every image that was drawn. */
    this.onDrawn = () => {};
    for (const [name, words] of fieldset ? Object.entries(OVERLAYS) : []) {
      fieldset.append(toggle(words, true, (on) => { this.shows[name] = on; this.draw(); }, `overlay-${name}`));
    }
    new ResizeObserver(() => this.fit()).observe(canvas);
  }

  /** Be about another run; null: about none. */
  begin(hello) {
    this.hello = hello;
    const { relations, states } = hello?.procedure ?? { relations: [], states: [] };
    this.zones = relations.map((relation) => ({ relation, ...zoneOf(relation, hello.anatomy) })).filter((zone) => zone.outline);
    this.colors = Object.fromEntries(states.map((state) => [state.name, state.color]));
    this.picture = this.header = null;
    this.draw();
  }

  /** Show a message; of those that come while one is decoded only the newest is. */
  async show(header, picture) {
    if (this.decoding) { this.waiting = [header, picture]; return; }
    this.decoding = true;
    try {
      if (picture) {
        const made = picture instanceof ImageBitmap;
        const bitmap = made ? picture : await createImageBitmap(new Blob([picture], { type: "image/jpeg" }));
        this.picture?.close();
        this.picture = bitmap;
      }
      this.header = header;
      this.canvas.classList.toggle("lost", !picture);
      this.draw();
      this.onDrawn(header);
    } finally {
      this.decoding = false;
      const next = this.waiting;
      this.waiting = null;
      if (next) this.show(...next);
    }
  }

  /** Choose what is drawn over the picture, where there are no switches. */
  choose(names) { this.shows = Object.fromEntries(names.map((name) => [name, true])); this.draw(); }

  fit() {
    const ratio = devicePixelRatio || 1;
    const side = Math.round(Math.min(this.canvas.clientWidth, this.canvas.clientHeight) * ratio);
    if (side > 0 && side !== this.canvas.width) { this.canvas.width = this.canvas.height = side; this.draw(); }
  }

  draw() {
    const { context: c, canvas: { width } } = this;
    c.fillStyle = "#000";
    c.fillRect(0, 0, width, width);
    if (!this.hello) return;
    if (this.picture) c.drawImage(this.picture, 0, 0, width, width);
    const half = this.hello.view.half_mm;
    this.scale = width / (2 * half);
    this.at = ([x, y]) => [(x + half) * this.scale, (half - y) * this.scale];
    this.unit = Math.max(1, width / 560);
    const held = new Set((this.header?.edges ?? []).map(String));
    const own = this.colors[this.header?.state] ?? LINE;
    for (const zone of this.zones) this.drawZone(zone, held.has(named(zone.relation)), own);
    if (this.shows.target) this.drawTarget();
    if (this.shows.needle && this.header) this.drawNeedle(own);
  }

  drawZone({ kind, outline }, holds, own) {
    if (!this.shows[kind]) return;
    const c = this.context;
    this.path(outline, true);
    c.globalAlpha = holds ? 0.2 : 0.04;
    c.fillStyle = holds ? own : LINE;
    c.fill();
    c.globalAlpha = holds ? 1 : 0.6;
    c.setLineDash(holds ? [] : [5 * this.unit, 5 * this.unit]);
    this.halo(holds ? own : LINE, holds ? 2 : 1, holds ? 2 : 1.2);
    c.setLineDash([]);
    c.globalAlpha = 1;
  }

  drawTarget() {
    const targets = this.hello.procedure.entities.filter((e) => e.geometry === "point" && e.group === "anatomy" && e.name !== "trocar");
    const c = this.context;
    for (const { name } of targets) {
      const [x, y] = this.at(this.hello.anatomy[name]?.at_mm ?? [NaN, NaN]);
      const arm = 11 * this.unit;
      c.beginPath();
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
        c.moveTo(x + dx * arm * 0.4, y + dy * arm * 0.4);
        c.lineTo(x + dx * arm, y + dy * arm);
      }
      this.halo("#fff", 2);
    }
  }

  drawNeedle(own) {
    const c = this.context;
    for (const shape of Object.values(this.header.found)) {
      if (shape.type === "segment") { this.path([shape.start_mm, shape.end_mm], false); this.halo(own, 2.5); }
      if (shape.type === "circle") { this.path(ring(shape.center_mm, shape.radius_mm), true); this.halo(own, 2.5); }
      if (shape.type === "polyline") { this.path(shape.points_mm, false); this.halo(own, 2.5); }
    }
    for (const shape of Object.values(this.header.found)) {
      if (shape.type !== "point") continue;
      const [x, y] = this.at(shape.at_mm);
      c.beginPath();
      c.arc(x, y, 6 * this.unit, 0, 2 * Math.PI);
      this.halo(own, 2.5);
    }
  }

  path(points, closes) {
    const c = this.context;
    c.beginPath();
    points.forEach((point, number) => (number ? c.lineTo(...this.at(point)) : c.moveTo(...this.at(point))));
    if (closes) c.closePath();
  }

  /** Stroke a line that can be seen on bright and dark: with a dark edge. */
  halo(color, width, edge = 3) {
    const c = this.context;
    c.lineCap = "round";
    c.strokeStyle = "#000a"; c.lineWidth = (width + edge) * this.unit; c.stroke();
    c.strokeStyle = color; c.lineWidth = width * this.unit; c.stroke();
  }
}

function named(relation) { return String([relation.subject, relation.predicate, relation.object]); }
