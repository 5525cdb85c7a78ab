/** Draws a draft over the picture, with handles that pointer and keyboard move. */

import { retinaHandles } from "./draft.js";
import { svg } from "../common/dom.js";

/** @type {Record<string, Vec>} */
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const STEP_PX = 0.5, LARGE_STEP_PX = 5, GRAB_RADIUS = 15;
const SHAPES = {  // around (0, 0), in pixels of the screen
  center: "M-9 0H9M0 -9V9", radius: "M-5 0A5 5 0 1 0 5 0A5 5 0 1 0 -5 0", retina: "M-4 -4H4V4H-4Z",
  trocar: "M0 -9L9 6H-9Z", target: "M-8 0A8 8 0 1 0 8 0A8 8 0 1 0 -8 0M-14 0H-5M5 0H14M0 -14V-5M0 5V14",
};
const COLORS = { center: "globe", radius: "globe", retina: "retina", trocar: "trocar", target: "target" };

export class Handles {
  /** By key of the handle. @type {Map<string, SVGGElement>} */ elements = new Map();
  /** @type {Map<string, Handle>} */ handles = new Map();
  /** @type {Draft | null} */ draft = null;
  /** @type {Vec[]} */ outline_px = [];
  size = [1, 1];
  /** @type {{ key: string, at: Vec, hasMoved: boolean } | null} */ dragged = null;
  isByKey = false;
  /** Called with a handle that is dropped after a drag. @type {(handle: Handle) => void} */ onDrop = () => {};
  /** Called with a handle that is clicked, or confirmed by Enter. @type {(handle: Handle) => void} */ onConfirm = () => {};
  /** Called with a handle that is to be removed. @type {(handle: Handle) => void} */ onRemove = () => {};
  /** Called with the position [px] to magnify, or null. @type {(at: Vec | null) => void} */ onMagnify = () => {};

  /** @param {SVGSVGElement} root over the picture, and as large @param {(handle: Handle, step: Vec, how: "pointer" | "keyboard") => void} onMove */
  constructor(root, onMove) {
    this.root = root; this.onMove = onMove;
    this.lines = ["halo globe", "globe", "halo retina", "retina", "halo axis-halo", "axis"].map((kind) => svg("path", { class: `line ${kind}` }));
    this.group = svg("g");
    root.append(...this.lines, this.group);
    new ResizeObserver(() => this.draw()).observe(root);
  }

  begin(/** @type {number} */ width_px, /** @type {number} */ height_px) {
    this.size = [width_px, height_px];
    this.root.setAttribute("viewBox", `-0.5 -0.5 ${width_px} ${height_px}`);  // the centre of the first pixel is (0, 0)
    this.group.replaceChildren();
    this.elements.clear();
  }

  /** Image pixels per pixel of the screen. */
  get scale() { return Math.max(this.size[0] / (this.root.clientWidth || 1), this.size[1] / (this.root.clientHeight || 1)); }

  show(/** @type {Draft} */ draft, /** @type {Vec[]} */ outline_px) { this.draft = draft; this.outline_px = outline_px; this.draw(); }

  draw() {
    const { draft } = this;
    if (!draft) return;
    const used = draft.trocars.find((each) => each.used);
    const globe = this.outline_px.length ? `${path(this.outline_px)}Z` : "", retina = path(draft.contour_px);
    const axis = used ? path([used.point_px, draft.target_px]) : "";
    [globe, globe, retina, retina, axis, axis].forEach((d, number) => this.lines[number].setAttribute("d", d));
    const wanted = this.wanted(draft);
    this.handles = new Map(wanted.map((each) => [each.key, each]));
    for (const [key, element] of this.elements) if (!this.handles.has(key)) { element.remove(); this.elements.delete(key); }
    wanted.forEach((handle, number) => this.place(handle, wanted.slice(number + 1)));
    const focused = wanted.find((each) => this.elements.get(each.key) === document.activeElement);
    const magnified = this.dragged ? this.handles.get(this.dragged.key) : this.isByKey ? focused : null;
    this.onMagnify(magnified ? magnified.at : null);
  }

  /** Return the handles of a draft, those to be drawn on top last. @param {Draft} draft @returns {Handle[]} */
  wanted(draft) {
    const quarter = this.outline_px.length / 4;
    const sides = quarter ? [this.outline_px[quarter], this.outline_px[3 * quarter]].sort((a, b) => b[0] - a[0]) : [];
    return [
      { key: "center", kind: "center", index: 0, title: "Globe centre", at: draft.center_px },
      ...sides.map((at, side) => /** @type {Handle} */ ({ key: side ? "radius west" : "radius east", kind: "radius", index: 0, title: "Globe edge", at })),
      ...retinaHandles(draft).map((index, number) => /** @type {Handle} */ ({ key: `retina ${index}`, kind: "retina", index, title: `Retina ${number + 1}`, at: draft.contour_px[index] })),
      ...draft.trocars.map(({ name, used, point_px }, index) => /** @type {Handle} */ ({ key: `trocar ${index}`, kind: "trocar", index, title: `Trocar ${name}${used ? ", in use" : ""}`, label: `${name}${used ? " (in use)" : ""}`, at: point_px })),
      { key: "target", kind: "target", index: 0, title: "Target", label: "target", at: draft.target_px },
    ];
  }

  place(/** @type {Handle} */ handle, /** @type {Handle[]} */ above) {
    const element = this.elements.get(handle.key) ?? this.add(handle, above), [x, y] = handle.at;
    element.setAttribute("transform", `translate(${x.toFixed(3)} ${y.toFixed(3)}) scale(${this.scale})`);
    element.setAttribute("aria-label", `${handle.title}, ${x.toFixed(1)}, ${y.toFixed(1)} px`);
    const text = element.querySelector("text");
    if (!text) return;
    const isLeft = this.draft && handle.kind === "trocar" && x < this.draft.center_px[0];  // so that the names of two trocars do not meet
    text.textContent = handle.label ?? "";
    text.setAttribute("text-anchor", isLeft ? "end" : "start");
    text.setAttribute("x", isLeft ? "-14" : "16");
  }

  /** Create the element of a handle, below those that are drawn, and reached by Tab, after it. @param {Handle} handle @param {Handle[]} above */
  add({ key, kind, label }, above) {
    const element = svg("g", { class: `handle ${kind}`, tabindex: 0, role: "button", "data-key": key },
      svg("circle", { class: "area", r: GRAB_RADIUS }), svg("path", { class: "under", d: SHAPES[kind] }), svg("path", { class: "mark", d: SHAPES[kind] }),
      ...(label ? [svg("text", { y: -10 })] : []));
    this.group.insertBefore(element, above.map((each) => this.elements.get(each.key)).find(Boolean) ?? null);
    element.style.setProperty("--own", `var(--${COLORS[kind]})`);
    element.addEventListener("pointerdown", (event) => this.grab(event, element, key));
    element.addEventListener("keydown", (event) => this.press(event, key));
    element.addEventListener("focus", () => this.draw());
    element.addEventListener("blur", () => { this.isByKey = false; this.draw(); });
    this.elements.set(key, element);
    return element;
  }

  handle(/** @type {string} */ key) { return /** @type {Handle} */ (this.handles.get(key)); }

  /** @param {PointerEvent} event @returns {Vec} */
  at(event) {
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.root.getScreenCTM()?.inverse());
    return [x, y];
  }

  grab(/** @type {PointerEvent} */ event, /** @type {SVGGElement} */ element, /** @type {string} */ key) {
    if (event.button !== 0) return;
    event.preventDefault();
    element.focus({ preventScroll: true });
    element.setPointerCapture(event.pointerId);
    element.classList.add("dragged");
    const drag = this.dragged = { key, at: this.at(event), hasMoved: false };
    const move = (/** @type {PointerEvent} */ moved) => {
      const at = this.at(moved), [fromX, fromY] = drag.at;
      Object.assign(drag, { at, hasMoved: true });
      this.onMove(this.handle(key), [at[0] - fromX, at[1] - fromY], "pointer");
    };
    element.addEventListener("pointermove", move);
    element.addEventListener("lostpointercapture", () => {
      element.removeEventListener("pointermove", move);
      element.classList.remove("dragged");
      this.dragged = null;
      if (drag.hasMoved) this.onDrop(this.handle(key)); else this.onConfirm(this.handle(key));
      this.draw();
    }, { once: true });
    this.draw();
  }

  /** Focus a handle. @param {string} key */
  focus(key) { this.elements.get(key)?.focus({ preventScroll: true }); }

  press(/** @type {KeyboardEvent} */ event, /** @type {string} */ key) {
    if (event.key === "Enter") return this.onConfirm(this.handle(key));
    if (event.key === "Delete") return this.onRemove(this.handle(key));
    const direction = ARROWS[event.key];
    if (!direction || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    this.isByKey = true;
    const step = event.shiftKey ? LARGE_STEP_PX : STEP_PX;
    this.onMove(this.handle(key), [direction[0] * step, direction[1] * step], "keyboard");
  }
}

/** @param {Vec[]} points */
function path(points) { return points.map(([x, y], number) => `${number ? "L" : "M"}${x.toFixed(2)} ${y.toFixed(2)}`).join(""); }
