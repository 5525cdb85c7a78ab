/** Edits of a draft, each of which returns a new one, and their history. Positions are pixels of the stored image. */

const COALESCE_MS = 1000, RETINA_HANDLES = 10, WALL_MIDDLE = 1.07;
/** The server's limit. */
export const MAX_TROCARS = 8;

/** @param {Vec} point @param {Vec} step @returns {Vec} */
const plus = ([x, y], [dx, dy]) => [x + dx, y + dy];
/** @param {Vec} center @param {number} factor @returns {(point: Vec) => Vec} */
const scaledAbout = ([cx, cy], factor) => ([x, y]) => [cx + (x - cx) * factor, cy + (y - cy) * factor];

/** Map everything that belongs to the globe. @param {Draft} draft @param {(point: Vec) => Vec} map */
function mapped(draft, map) {
  return {
    contour_px: draft.contour_px.map(map),
    target_px: map(draft.target_px),
    trocars: draft.trocars.map((trocar) => ({ ...trocar, point_px: map(trocar.point_px) })),
  };
}

/** Change one trocar. @param {Draft} draft @param {number} index @param {(trocar: DraftTrocar) => Partial<DraftTrocar>} change @returns {Draft} */
function withTrocar(draft, index, change) {
  return { ...draft, trocars: draft.trocars.map((each, number) => (number === index ? { ...each, ...change(each) } : each)) };
}

/** What a draft assumes, without what an edit has stated. @param {Draft} draft @param {string[]} names */
function unlessStated({ assumed }, ...names) { return { assumed: assumed.filter((name) => !names.includes(name)) }; }

/** What stating the position of a handle states. @type {Record<Handle["kind"], string[]>} */
const STATES = { center: ["globe", "rim"], radius: ["globe", "rim"], retina: ["retina"], trocar: ["trocar"], target: ["target"] };

export const edits = {
  /** State that a position is right as it is. @param {Draft} draft @param {Handle["kind"]} kind @returns {Draft} */
  confirm(draft, kind) {
    return STATES[kind].some((name) => draft.assumed.includes(name)) ? { ...draft, ...unlessStated(draft, ...STATES[kind]) } : draft;
  },
  /** @param {Draft} draft @param {number} value @returns {Draft} */
  diameter(draft, value) { return { ...draft, diameter_mm: value, ...unlessStated(draft, "scale") }; },
  /** @param {Draft} draft @param {Vec} step @param {boolean} together @returns {Draft} */
  center(draft, step, together) {
    return { ...draft, ...unlessStated(draft, ...STATES.center), ...(together ? mapped(draft, (point) => plus(point, step)) : {}), center_px: plus(draft.center_px, step) };
  },
  /** @param {Draft} draft @param {number} factor @param {boolean} together @returns {Draft} */
  radius(draft, factor, together) {
    return { ...draft, ...unlessStated(draft, ...STATES.radius), ...(together ? mapped(draft, scaledAbout(draft.center_px, factor)) : {}), radius_px: draft.radius_px * factor };
  },
  /** Move a point of the retina, and its neighbours less and less, up to the next handle. @param {Draft} draft @param {number} index @param {Vec} step @returns {Draft} */
  retina(draft, index, [dx, dy]) {
    const spacing = retinaSpacing(draft);
    const contour_px = draft.contour_px.map((point, number) => {
      const distance = Math.abs(number - index) / spacing;
      const share = distance < 1 ? (1 + Math.cos(Math.PI * distance)) / 2 : 0;
      return plus(point, [dx * share, dy * share]);
    });
    return { ...draft, contour_px, ...unlessStated(draft, "retina") };
  },
  /** @param {Draft} draft @param {number} index @param {Vec} step */
  trocar(draft, index, step) { return withTrocar({ ...draft, ...unlessStated(draft, "trocar") }, index, ({ point_px }) => ({ point_px: plus(point_px, step) })); },
  /** Add a trocar in the wall of the globe's upper half, as far as possible from the others. @param {Draft} draft @param {Vec[]} outline_px @returns {Draft} */
  addTrocar(draft, outline_px) {
    const [cx, cy] = draft.center_px;
    const distance = (/** @type {Vec} */ [x, y]) => Math.min(...draft.trocars.map(({ point_px }) => Math.hypot(x - point_px[0], y - point_px[1])));
    const upper = outline_px.filter(([x, y]) => cy - y > 0.5 * Math.hypot(x - cx, y - cy)).map(scaledAbout(draft.center_px, WALL_MIDDLE));
    const point_px = upper.reduce((best, point) => (distance(point) > distance(best) ? point : best));
    const side = point_px[0] < cx === draft.mirrored ? "right" : "left";
    const names = new Set(draft.trocars.map(({ name }) => name));
    let name = side;
    for (let number = 2; names.has(name); number++) name = `${side} ${number}`;
    return { ...draft, trocars: [...draft.trocars, { name, point_px, used: false }] };
  },
  /** Remove a trocar; if the needle was in it, the first one becomes the one in use. @param {Draft} draft @param {number} index @returns {Draft} */
  removeTrocar(draft, index) {
    const trocars = draft.trocars.filter((_, number) => number !== index);
    return trocars.some(({ used }) => used) ? { ...draft, trocars } : edits.used({ ...draft, trocars }, 0);
  },
  /** @param {Draft} draft @param {number} index @param {string} name */
  rename(draft, index, name) { return withTrocar(draft, index, () => ({ name })); },
  /** @param {Draft} draft @param {Vec} step @returns {Draft} */
  target(draft, step) { return { ...draft, target_px: plus(draft.target_px, step), ...unlessStated(draft, "target") }; },
  /** @param {Draft} draft @param {number} index @returns {Draft} */
  used(draft, index) { return { ...draft, ...unlessStated(draft, "trocar"), trocars: draft.trocars.map((each, number) => ({ ...each, used: number === index })) }; },
  /** Set whether images are mirrored; left and right swap in the names of trocars. @param {Draft} draft @param {boolean} mirrored @returns {Draft} */
  mirrored(draft, mirrored) {
    const swapped = (/** @type {string} */ name) => name.replace(/^(left|right)/, (side) => (side === "left" ? "right" : "left"));
    const trocars = draft.trocars.map((each) => ({ ...each, name: swapped(each.name) }));
    return { ...draft, mirrored, ...unlessStated(draft, "mirror"), trocars: mirrored === draft.mirrored ? draft.trocars : trocars };
  },
};

/** Return the number of points between two handles of the retina. @param {Draft} draft */
function retinaSpacing(draft) { return Math.max(1, (draft.contour_px.length - 1) / (RETINA_HANDLES - 1)); }

/** Return which points of the retina have handles: an even number, so that none is hidden by a target at the bottom. @param {Draft} draft */
export function retinaHandles(draft) {
  const count = Math.min(RETINA_HANDLES, draft.contour_px.length);
  return Array.from({ length: count }, (_, number) => Math.round((number * (draft.contour_px.length - 1)) / (count - 1)));
}

/** The present draft, with those before and after it. */
export class History {
  /** @type {Draft[]} */ past = [];
  /** @type {Draft[]} */ future = [];
  last = { what: "", at_ms: 0 };

  /** @param {Draft} draft the detected one */
  constructor(draft) { this.detected = this.present = draft; }

  /** Add a draft; a drag, or key presses in quick succession, count as one edit. @param {Draft} draft @param {string} what is edited, and how */
  put(draft, what) {
    const at_ms = performance.now();
    const isSame = what && what === this.last.what && (what.endsWith("pointer") || at_ms - this.last.at_ms < COALESCE_MS);
    if (!isSame) this.past.push(this.present);
    this.last = { what, at_ms };
    this.future = [];
    this.present = draft;
  }

  /** End an edit: the next one counts by itself. */
  endEdit() { this.last = { what: "", at_ms: 0 }; }

  undo() { this.move(this.past, this.future); }
  redo() { this.move(this.future, this.past); }
  restore() { if (this.present !== this.detected) { this.put(this.detected, ""); this.endEdit(); } }

  move(/** @type {Draft[]} */ from, /** @type {Draft[]} */ to) {
    const draft = from.pop();
    if (!draft) return;
    to.push(this.present);
    this.present = draft;
    this.endEdit();
  }
}
