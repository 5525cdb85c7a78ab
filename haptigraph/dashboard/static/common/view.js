/** The eye as the surgeon sees it, overlaid with the detected shapes and the regions in which relations hold. */

import { checkbox, make, setText } from "./dom.js";
import { circle, zoneOf } from "./zones.js";

/** Those with a switch. @type {Partial<Record<Overlay, string>>} */ const OVERLAYS = { needle: "Instrument", uncertainty: "Uncertainty", cone: "Cone", zone: "Zones", target: "Target" };
const LINE = "#b9d6ec", REGION_SD = 2;

export class View {
  /** Which overlays are drawn. @type {Partial<Record<Overlay, boolean>>} */ overlays = {};
  /** @type {Hello | null} */ hello = null;
  /** @type {ImageHeader | null} */ header = null;
  /** @type {ImageBitmap | null} */ picture = null;
  /** @type {{ relation: string, kind: "cone" | "zone", outline: Vec[] }[]} */ zones = [];
  /** @type {Map<string, string>} */ colors = new Map();
  /** Tips by the shaft that they end. @type {Map<string, string>} */ tips = new Map();
  /** The newest message that arrived while another was being decoded. @type {[ImageHeader, Picture] | null} */ waiting = null;
  isDecoding = false; half_mm = 1; /** @type {Vec} */ center_mm = [0, 0];
  /** Whether the instrument was found in the eye in this run. */ hasEntered = false;
  /** Names the size of the uncertainty region, next to its switch. */ region = make("span", { className: "region" });
  /** Called with the header of every image that was drawn. @type {(header: ImageHeader) => void} */ onDrawn = () => {};

  /** @param {HTMLCanvasElement} canvas @param {HTMLElement | null} fieldset for the switches of the overlays; null: no switches */
  constructor(canvas, fieldset) {
    this.canvas = canvas;
    this.context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d", { alpha: false }));
    for (const name of /** @type {Overlay[]} */ (fieldset ? Object.keys(OVERLAYS) : [])) {
      const label = checkbox(OVERLAYS[name] ?? "", true, (isOn) => { this.overlays[name] = isOn; this.draw(); }, `overlay-${name}`);
      if (name === "uncertainty") { label.title = "Within 2 standard deviations of the tip"; label.append(this.region); }
      fieldset?.append(label);
    }
    new ResizeObserver(() => this.fit()).observe(canvas);
  }

  /** Show another run. @param {Hello | null} hello null: show nothing */
  begin(hello) {
    const { anatomy = {}, procedure: { entities, relations, states } = { entities: [], relations: [], states: [] } } = hello ?? {};
    this.hello = hello;
    this.half_mm = hello?.view.half_mm ?? 1;
    this.center_mm = hello?.view.center_mm ?? [0, 0];
    this.zones = relations.flatMap((relation) => {
      const zone = zoneOf(relation, anatomy);
      return zone ? { ...zone, relation: String([relation.subject, relation.predicate, relation.object]) } : [];
    });
    this.tips = new Map(entities.flatMap((e) => (e.only_with ? [[e.only_with, e.name]] : e.geometry === "segment" && e.visible_with ? [[e.name, e.visible_with]] : [])));
    this.colors = new Map(states.map((state) => [state.name, state.color]));
    this.picture = this.header = null;
    this.hasEntered = false;
    this.draw();
  }

  /** Show an image; of those that arrive during decoding, only the newest. @param {ImageHeader} header @param {Picture} picture */
  async show(header, picture) {
    if (this.isDecoding) { this.waiting = [header, picture]; return; }
    this.isDecoding = true;
    try {
      if (picture) {
        const bitmap = picture instanceof ImageBitmap ? picture : await createImageBitmap(new Blob([picture], { type: "image/jpeg" }));
        this.picture?.close();
        this.picture = bitmap;
      }
      this.header = header;
      this.hasEntered ||= this.isInside(header.found);
      this.canvas.classList.toggle("lost", !picture);
      this.draw();
      this.onDrawn(header);
    } finally {
      this.isDecoding = false;
      const next = this.waiting;
      this.waiting = null;
      if (next) this.show(...next);
    }
  }

  /** Choose the overlays where there are no switches. @param {Overlay[]} names */
  choose(names) { this.overlays = Object.fromEntries(names.map((name) => [name, true])); this.draw(); }

  fit() {
    const ratio = devicePixelRatio || 1;
    const side = Math.round(Math.min(this.canvas.clientWidth, this.canvas.clientHeight) * ratio);
    if (side > 0 && side !== this.canvas.width) { this.canvas.width = this.canvas.height = side; this.draw(); }
  }

  /** Convert mm of the eye frame to canvas pixels. @param {Vec} place @returns {Vec} */
  toCanvas([x, y]) {
    const scale = this.canvas.width / (2 * this.half_mm);
    return [(x - this.center_mm[0] + this.half_mm) * scale, (this.half_mm - y + this.center_mm[1]) * scale];
  }

  /** Line widths and symbols grow with the canvas. */
  get unit() { return Math.max(1, this.canvas.width / 560); }

  draw() {
    const { context: c, canvas: { width }, hello, header } = this;
    c.fillStyle = "#000";
    c.fillRect(0, 0, width, width);
    if (!hello) return;
    if (this.picture) c.drawImage(this.picture, 0, 0, width, width);
    const held = new Set((header?.edges ?? []).map(String)), color = this.colors.get(header?.state ?? "") ?? LINE;
    for (const { kind, outline, relation } of this.zones) if (this.overlays[kind]) this.drawZone(outline, held.has(relation), color);
    if (this.overlays.target) this.drawTargets(hello);
    if (this.overlays.port && !this.hasEntered) this.drawPort(hello);
    if (header) this.drawUncertainty(header);
    if (this.overlays.needle && header) for (const shapes of [header.found, ...header.beside]) this.drawShapes(shapes, color);
  }

  drawZone(/** @type {Vec[]} */ outline, /** @type {boolean} */ holds, /** @type {string} */ color) {
    const c = this.context;
    this.path(outline, true);
    c.globalAlpha = holds ? 0.2 : 0.04;
    c.fillStyle = holds ? color : LINE;
    c.fill();
    c.setLineDash(holds ? [] : [5 * this.unit, 5 * this.unit]);
    c.globalAlpha = 1;
    this.stroke(holds ? color : LINE, holds ? 2 : 1.2, holds ? 2.4 : 2);
    c.setLineDash([]);
  }

  drawTargets(/** @type {Hello} */ { anatomy, procedure }) {
    const targets = procedure.entities.filter((e) => e.geometry === "point" && e.group === "anatomy" && e.name !== "trocar");
    const c = this.context, arm = 11 * this.unit;
    for (const { name } of targets) {
      const shape = anatomy[name];
      if (shape?.type !== "point") continue;
      const [x, y] = this.toCanvas(shape.at_mm);
      c.beginPath();
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
        c.moveTo(x + dx * arm * 0.4, y + dy * arm * 0.4);
        c.lineTo(x + dx * arm, y + dy * arm);
      }
      this.stroke("#fff", 2);
    }
  }

  /** The port through which the instrument enters, or null where the anatomy has none. @param {Hello | null} hello */
  static portOf(hello) { const port = hello?.anatomy.trocar; return port?.type === "point" ? port : null; }

  /** Return whether an instrument ends nearer to the eye's centre than the port. @param {Record<string, Shape>} found */
  isInside(found) {
    const port_mm = Math.hypot(...View.portOf(this.hello)?.at_mm ?? [0]);
    return Object.values(found).some((shape) => Math.hypot(...shape.type === "point" ? shape.at_mm : shape.type === "segment" ? shape.end_mm : [Infinity]) < port_mm);
  }

  /** Mark the port: a ring around it, and an arrow along the way into the eye. */
  drawPort(/** @type {Hello} */ hello) {
    const port = View.portOf(hello);
    if (!port) return;
    const c = this.context, { unit } = this, [x, y] = this.toCanvas(port.at_mm), center = this.canvas.width / 2;
    const length = Math.hypot(center - x, center - y) || 1, ux = (center - x) / length, uy = (center - y) / length;
    c.beginPath();
    c.arc(x, y, 12 * unit, 0, 2 * Math.PI);
    this.stroke("#ffd54a", 2.5);
    c.beginPath();
    const at = (/** @type {number} */ along, /** @type {number} */ across) => /** @type {Vec} */ ([x + (ux * along - uy * across) * unit, y + (uy * along + ux * across) * unit]);
    c.moveTo(...at(18, 0)); c.lineTo(...at(58, 0));
    c.moveTo(...at(46, -9)); c.lineTo(...at(58, 0)); c.lineTo(...at(46, 9));
    this.stroke("#ffd54a", 3);
  }

  /** Draw where the tip may be, and name its size, or why there is none. */
  drawUncertainty(/** @type {ImageHeader} */ { found, sd_mm }) {
    const c = this.context, tips = [...this.tips.values()].filter((name) => name in found);
    setText(this.region, tips.length ? "not estimated" : "");
    for (const [name, sd] of Object.entries(sd_mm)) {
      const shape = found[name], radius_mm = REGION_SD * sd;
      if (shape?.type !== "point") continue;
      setText(this.region, radius_mm < 0.01 ? "2 sd < 0.01 mm" : `2 sd ${radius_mm.toFixed(2)} mm`);
      if (!this.overlays.uncertainty) continue;
      this.path(circle(shape.at_mm, radius_mm), true);
      c.globalAlpha = 0.25; c.fillStyle = "#fff"; c.fill(); c.globalAlpha = 1;
      c.setLineDash([3 * this.unit, 4 * this.unit]);
      this.stroke("#fff", 1.5, 2.4);
      c.setLineDash([]);
    }
  }

  drawShapes(/** @type {Record<string, Shape>} */ found, /** @type {string} */ color) {
    const c = this.context, shapes = Object.values(found);
    for (const [name, shape] of Object.entries(found)) {
      if (shape.type === "segment") {
        this.path([shape.start_mm, shape.end_mm], false);
        c.setLineDash((this.tips.get(name) ?? name) in found ? [] : [8 * this.unit, 7 * this.unit]);
        this.stroke(color, 2.5);
        c.setLineDash([]);
      }
      if (shape.type === "circle") { this.path(circle(shape.center_mm, shape.radius_mm), true); this.stroke(color, 2.5); }
      if (shape.type === "polyline") { this.path(shape.points_mm, false); this.stroke(color, 2.5); }
    }
    for (const shape of shapes) {
      if (shape.type !== "point") continue;
      c.beginPath();
      c.arc(...this.toCanvas(shape.at_mm), 6 * this.unit, 0, 2 * Math.PI);
      this.stroke(color, 2.5);
    }
  }

  path(/** @type {Vec[]} */ points, /** @type {boolean} */ isClosed) {
    const c = this.context;
    c.beginPath();
    points.forEach((point, number) => (number ? c.lineTo(...this.toCanvas(point)) : c.moveTo(...this.toCanvas(point))));
    if (isClosed) c.closePath();
  }

  /** Stroke a bright line with a dark edge, so that one of them is visible on any background. @param {string} color @param {number} width */
  stroke(color, width, edge = 3) {
    const c = this.context;
    c.lineCap = "round";
    c.strokeStyle = "#000e"; c.lineWidth = (width + edge) * this.unit; c.stroke();
    c.strokeStyle = `color-mix(in srgb, ${color} 80%, white)`; c.lineWidth = width * this.unit; c.stroke();
  }
}
