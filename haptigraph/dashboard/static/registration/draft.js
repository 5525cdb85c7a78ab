/** A draft and its past: every edit makes a new draft. Places are pixels of the image as stored. Knows no page. */

const COALESCE_MS = 1000, RETINA_HANDLES = 10, WALL_MIDDLE = 1.07;
/** As many trocars as the server takes. */
export const MOST_TROCARS = 8;

const plus = ([x, y], [dx, dy]) => [x + dx, y + dy];
const about = ([cx, cy], factor) => ([x, y]) => [cx + (x - cx) * factor, cy + (y - cy) * factor];

/** Move everything that belongs to the globe. */
function all(draft, way) {
  return {
    contour_px: draft.contour_px.map(way),
    target_px: way(draft.target_px),
    trocars: draft.trocars.map((trocar) => ({ ...trocar, point_px: way(trocar.point_px) })),
  };
}

export const edits = {
  center(draft, step, together) {
    return { ...draft, ...(together ? all(draft, (place) => plus(place, step)) : {}), center_px: plus(draft.center_px, step) };
  },
  radius(draft, factor, together) {
    return { ...draft, ...(together ? all(draft, about(draft.center_px, factor)) : {}), radius_px: draft.radius_px * factor };
  },
  /** Move a point of the retina, and its neighbours ever less, up to the next handle. */
  retina(draft, index, step) {
    const reach = retinaSpacing(draft);
    const contour_px = draft.contour_px.map((place, number) => {
      const away = Math.abs(number - index) / reach;
      const share = away < 1 ? (1 + Math.cos(Math.PI * away)) / 2 : 0;
      return plus(place, [step[0] * share, step[1] * share]);
    });
    return { ...draft, contour_px };
  },
  trocar(draft, index, step) {
    return { ...draft, trocars: draft.trocars.map((each, number) => (number === index ? { ...each, point_px: plus(each.point_px, step) } : each)) };
  },
  /** Put a trocar into the wall, at the place of the globe's upper half that is farthest from all others. */
  addTrocar(draft, outline_px) {
    const [cx, cy] = draft.center_px;
    const away = ([x, y]) => Math.min(...draft.trocars.map(({ point_px }) => Math.hypot(x - point_px[0], y - point_px[1])));
    const upper = outline_px.filter(([x, y]) => cy - y > 0.5 * Math.hypot(x - cx, y - cy)).map(about(draft.center_px, WALL_MIDDLE));
    const point_px = upper.reduce((best, place) => (away(place) > away(best) ? place : best));
    const side = point_px[0] < cx === draft.mirrored ? "right" : "left";
    const names = new Set(draft.trocars.map(({ name }) => name));
    let name = side;
    for (let number = 2; names.has(name); number++) name = `${side} ${number}`;
    return { ...draft, trocars: [...draft.trocars, { name, point_px, used: false }] };
  },
  /** Take a trocar away; if the needle was in it, it is in the first one now. */
  removeTrocar(draft, index) {
    const trocars = draft.trocars.filter((_, number) => number !== index);
    return trocars.some(({ used }) => used) ? { ...draft, trocars } : edits.used({ ...draft, trocars }, 0);
  },
  rename(draft, index, name) { return { ...draft, trocars: draft.trocars.map((each, number) => (number === index ? { ...each, name } : each)) }; },
  target(draft, step) { return { ...draft, target_px: plus(draft.target_px, step) }; },
  targetTo(draft, target_px) { return { ...draft, target_px }; },
  used(draft, index) { return { ...draft, trocars: draft.trocars.map((each, number) => ({ ...each, used: number === index })) }; },
  diameter(draft, diameter_mm) { return { ...draft, diameter_mm }; },
  /** What is left without a mirror is right with one. */
  mirrored(draft, mirrored) {
    const other = { left: "right", right: "left" };
    const trocars = draft.trocars.map((each) => ({ ...each, name: each.name.replace(/^(left|right)/, (side) => other[side]) }));
    return { ...draft, mirrored, trocars: mirrored === draft.mirrored ? draft.trocars : trocars };
  },
};

/** How far it is from one handle of the retina to the next, in points. */
function retinaSpacing(draft) { return Math.max(1, (draft.contour_px.length - 1) / (RETINA_HANDLES - 1)); }

/** Which points of the retina have handles: an even number, so that none hides under a target at the bottom. */
export function retinaHandles(draft) {
  const count = Math.min(RETINA_HANDLES, draft.contour_px.length);
  return Array.from({ length: count }, (_, number) => Math.round((number * (draft.contour_px.length - 1)) / (count - 1)));
}

/** The drafts before and after the present one. */
export class History {
  constructor(draft) { this.found = this.now = draft; this.past = []; this.future = []; this.last = { what: "", at_ms: 0 }; }

  /** Make a draft the present one; a drag is undone as one, and so are steps of one key that follow each other soon. */
  put(draft, what) {
    const at_ms = performance.now();
    const isOne = what && what === this.last.what && (what.endsWith("pointer") || at_ms - this.last.at_ms < COALESCE_MS);
    if (!isOne) this.past.push(this.now);
    this.last = { what, at_ms };
    this.future = [];
    this.now = draft;
  }

  /** What comes next is a step of its own. */
  settle() { this.last = { what: "", at_ms: 0 }; }

  undo() { if (this.past.length) { this.future.push(this.now); this.now = this.past.pop(); this.settle(); } }
  redo() { if (this.future.length) { this.past.push(this.now); this.now = this.future.pop(); this.settle(); } }
  again() { if (this.now !== this.found) { this.put(this.found, ""); this.settle(); } }
}
