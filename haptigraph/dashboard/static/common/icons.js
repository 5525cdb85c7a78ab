/** Icons of states, so that states differ in more than colour; drawn in a 48 x 48 box. */

import { svg } from "./dom.js";

const EDGE = 3;
/** @type {Record<StateDescription["icon"], [tag: "path" | "circle" | "rect", attributes: Record<string, string | number>][]>} */
const SHAPES = {
  alarm: [["path", { d: "M15 3h18l12 12v18L33 45H15L3 33V15z", fill: "own" }], ["path", { d: "M24 12v15M24 34v2", stroke: "ink", "stroke-width": 6 }]],
  done: [["circle", { cx: 24, cy: 24, r: 21, fill: "own" }], ["path", { d: "M13 25l8 8 14-17", stroke: "ink", "stroke-width": 5.5 }]],
  warn: [["path", { d: "M24 3 46 43H2z", fill: "own" }], ["path", { d: "M24 17v12M24 35v2", stroke: "ink", "stroke-width": 5 }]],
  calm: [["circle", { cx: 24, cy: 24, r: 19, stroke: "own", "stroke-width": 5 }], ["circle", { cx: 24, cy: 24, r: 8, fill: "own" }]],
  idle: [["circle", { cx: 24, cy: 24, r: 19, stroke: "own", "stroke-width": 4 }]],
  lost: [["rect", { x: 4, y: 4, width: 40, height: 40, rx: 6, stroke: "own", "stroke-width": 4, "stroke-dasharray": "8 6" }],
         ["path", { d: "M17 19c0-9 14-9 14 0 0 6-7 5-7 11M24 36v2", stroke: "own", "stroke-width": 4.5 }]],
  unseen: [["rect", { x: 4, y: 4, width: 40, height: 40, rx: 6, stroke: "own", "stroke-width": 4, "stroke-dasharray": "8 6" }],
           ["path", { d: "M15 24h18", stroke: "own", "stroke-width": 5 }]],
  tipless: [["rect", { x: 4, y: 4, width: 40, height: 40, rx: 6, stroke: "own", "stroke-width": 4, "stroke-dasharray": "8 6" }],
            ["path", { d: "M13 13 25 25M30.5 30.5h.01M36 36h.01", stroke: "own", "stroke-width": 5 }]],
};

/** Return the shapes of a state's icon, in its colours and with an edge, because some colours are near the page's. @param {StateDescription} state */
export function iconShapes(state) {
  /** @type {Record<string | number, string>} */ const colors = { own: state.color, ink: state.ink };
  const lines = { "stroke-linecap": "round", "stroke-linejoin": "round" };
  const edges = SHAPES[state.icon].filter(([, { fill, stroke }]) => fill === "own" || stroke === "own").map(([tag, { fill: _, stroke: __, ...shape }]) =>
    svg(tag, { ...lines, ...shape, class: "icon-edge", "stroke-width": Number(shape["stroke-width"] ?? 0) + EDGE }));
  return [...edges, ...SHAPES[state.icon].map(([tag, { fill = "none", stroke = "none", ...shape }]) =>
    svg(tag, { ...lines, ...shape, fill: colors[fill] ?? fill, stroke: colors[stroke] ?? stroke }))];
}

/** Return a state's icon as an element of its own; empty without a state. @param {StateDescription} [state] */
export function icon(state) { return svg("svg", { viewBox: "0 0 48 48" }, ...(state ? iconShapes(state) : [])); }
