/** Draws a draft over the picture and lets pointer and keyboard move its handles. Knows no server. */

import { retinaHandles } from "./draft.js";

const SVG = "http://www.w3.org/2000/svg";
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const STEP_PX = 0.5, LARGE_STEP_PX = 5, REACH = 15;
const SHAPES = {  // about (0, 0), in pixels of the screen
  center: "M-9 0H9M0 -9V9", radius: "M-5 0A5 5 0 1 0 5 0A5 5 0 1 0 -5 0", retina: "M-4 -4H4V4H-4Z",
  trocar: "M0 -9L9 6H-9Z", target: "M-8 0A8 8 0 1 0 8 0A8 8 0 1 0 -8 0M-14 0H-5M5 0H14M0 -14V-5M0 5V14",
};
const INKS = { center: "globe", radius: "globe", retina: "retina", trocar: "trocar", target: "target" };

function made(name, attributes, parent) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  parent.append(element);
  return element;
}

export class Handles {
  /**
   * @param {SVGSVGElement} svg over the picture, as large as it
   * @param {(handle: any, step: [number, number], how: "pointer" | "keyboard") => void} onMove
   */
  constructor(svg, onMove) {
    Object.assign(this, { svg, onMove, elements: new Map(), draft: null, size: [1, 1], dragged: null });
    /** Called with a handle that is let go after a drag. */
    this.onDrop = () => {};
    /** Called with a handle that somebody wants to take away. */
    this.onRemove = () => {};
    /** Called with the place [px] to look at closely, or null. */
    this.onLook = () => {};
    this.lines = ["halo globe", "globe", "halo retina", "retina", "axis"].map((kind) => made("path", { class: `line ${kind}` }, svg));
    this.group = made("g", {}, svg);
    new ResizeObserver(() => this.draw()).observe(svg);
  }

  begin(width_px, height_px) {
    this.size = [width_px, height_px];
    this.svg.setAttribute("viewBox", `-0.5 -0.5 ${width_px} ${height_px}`);  // the centre of the first pixel is (0, 0)
    this.group.replaceChildren();
    this.elements.clear();
  }

  /** Image pixels per pixel of the screen. */
  get scale() { return Math.max(this.size[0] / (this.svg.clientWidth || 1), this.size[1] / (this.svg.clientHeight || 1)); }

  show(draft, outline_px) { this.draft = draft; this.outline_px = outline_px; this.draw(); }

  draw() {
    const { draft } = this;
    if (!draft) return;
    const used = draft.trocars.find((each) => each.used);
    const globe = this.outline_px.length ? `${path(this.outline_px)}Z` : "", retina = path(draft.contour_px);
    const axis = used ? path([used.point_px, draft.target_px]) : "";
    [globe, globe, retina, retina, axis].forEach((way, number) => this.lines[number].setAttribute("d", way));
    const wanted = this.wanted();
    const keys = new Set(wanted.map((each) => each.key));
    for (const [key, element] of this.elements) if (!keys.has(key)) { element.remove(); this.elements.delete(key); }
    wanted.forEach((handle, number) => this.place(handle, wanted.slice(number + 1)));
    const focused = wanted.find((each) => this.elements.get(each.key) === document.activeElement);
    const looked = this.dragged ? wanted.find((each) => each.key === this.dragged.key) : this.isByKey && focused;
    this.onLook(looked ? looked.at : null);
  }

  /** The handles there should be, those to be drawn on top last. */
  wanted() {
    const { draft, outline_px } = this;
    const quarter = outline_px.length / 4;
    const sides = outline_px.length ? [["right", outline_px[quarter]], ["left", outline_px[3 * quarter]]] : [];
    const [east, west] = sides.sort((a, b) => b[1][0] - a[1][0]);
    return [
      { key: "center", kind: "center", says: "Globe's centre", at: draft.center_px },
      ...(sides.length ? [["radius east", east], ["radius west", west]].map(([key, [, at]]) => ({ key, kind: "radius", says: "Globe's edge", at })) : []),
      ...retinaHandles(draft).map((index, number) => ({ key: `retina ${index}`, kind: "retina", index, says: `Retina ${number + 1}`, at: draft.contour_px[index] })),
      ...draft.trocars.map((each, index) => ({ key: `trocar ${index}`, kind: "trocar", index, says: `Trocar ${each.name}${each.used ? ", in use" : ""}`, label: `${each.name}${each.used ? " (used)" : ""}`, at: each.point_px })),
      { key: "target", kind: "target", says: "Target", label: "target", at: draft.target_px },
    ];
  }

  place(handle, above) {
    const element = this.elements.get(handle.key) ?? this.added(handle, above);
    const [x, y] = handle.at;
    element.handle = handle;
    element.setAttribute("transform", `translate(${x.toFixed(3)} ${y.toFixed(3)}) scale(${this.scale})`);
    element.setAttribute("aria-label", `${handle.says}, ${x.toFixed(1)}, ${y.toFixed(1)} px`);
    const text = element.querySelector("text");
    if (text) text.textContent = handle.label;
  }

  /** Make the element of a handle, under those that are to be drawn, and tabbed to, after it. */
  added({ key, kind, label }, above) {
    const element = made("g", { class: `handle ${kind}`, tabindex: 0, role: "button", "data-key": key }, this.group);
    this.group.insertBefore(element, above.map((each) => this.elements.get(each.key)).find(Boolean) ?? null);
    element.style.setProperty("--own", `var(--${INKS[kind]})`);
    made("circle", { class: "area", r: REACH }, element);
    made("path", { class: "under", d: SHAPES[kind] }, element);
    made("path", { class: "mark", d: SHAPES[kind] }, element);
    if (label) made("text", { x: 16, y: -10 }, element);
    element.addEventListener("pointerdown", (event) => this.grab(event, element));
    element.addEventListener("keydown", (event) => this.key(event, element));
    element.addEventListener("focus", () => this.draw());
    element.addEventListener("blur", () => { this.isByKey = false; this.draw(); });
    this.elements.set(key, element);
    return element;
  }

  at(event) {
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.svg.getScreenCTM().inverse());
    return [x, y];
  }

  grab(event, element) {
    if (event.button !== 0) return;
    event.preventDefault();
    element.focus({ preventScroll: true });
    element.setPointerCapture(event.pointerId);
    element.classList.add("dragged");
    this.dragged = { key: element.handle.key, at: this.at(event) };
    const move = (moved) => {
      const at = this.at(moved), [fromX, fromY] = this.dragged.at;
      Object.assign(this.dragged, { at, moved: true });
      this.onMove(element.handle, [at[0] - fromX, at[1] - fromY], "pointer");
    };
    element.addEventListener("pointermove", move);
    element.addEventListener("lostpointercapture", () => {
      element.removeEventListener("pointermove", move);
      element.classList.remove("dragged");
      const { moved } = this.dragged;
      this.dragged = null;
      if (moved) this.onDrop(element.handle);
      this.draw();
    }, { once: true });
    this.draw();
  }

  /** Give a handle the focus. */
  focus(key) { this.elements.get(key)?.focus({ preventScroll: true }); }

  key(event, element) {
    if (event.key === "Delete") return this.onRemove(element.handle);
    const way = ARROWS[event.key];
    if (!way || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    this.isByKey = true;
    const step = event.shiftKey ? LARGE_STEP_PX : STEP_PX;
    this.onMove(element.handle, [way[0] * step, way[1] * step], "keyboard");
  }
}

function path(places) { return places.map(([x, y], number) => `${number ? "L" : "M"}${x.toFixed(2)} ${y.toFixed(2)}`).join(""); }
