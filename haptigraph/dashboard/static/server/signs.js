/** Shapes that stand for states beside their colour, drawn in a 48 x 48 box. */

const SVG = "http://www.w3.org/2000/svg";

const SHAPES = {
  alarm: [["path", { d: "M15 3h18l12 12v18L33 45H15L3 33V15z", fill: "own" }], ["path", { d: "M24 12v15M24 34v2", stroke: "ink", "stroke-width": 6 }]],
  done: [["circle", { cx: 24, cy: 24, r: 21, fill: "own" }], ["path", { d: "M13 25l8 8 14-17", stroke: "ink", "stroke-width": 5.5 }]],
  warn: [["path", { d: "M24 3 46 43H2z", fill: "own" }], ["path", { d: "M24 17v12M24 35v2", stroke: "ink", "stroke-width": 5 }]],
  calm: [["circle", { cx: 24, cy: 24, r: 19, stroke: "own", "stroke-width": 5 }], ["circle", { cx: 24, cy: 24, r: 8, fill: "own" }]],
  idle: [["circle", { cx: 24, cy: 24, r: 19, stroke: "own", "stroke-width": 4 }]],
  lost: [["rect", { x: 4, y: 4, width: 40, height: 40, rx: 6, stroke: "own", "stroke-width": 4, "stroke-dasharray": "8 6" }],
         ["path", { d: "M17 19c0-9 14-9 14 0 0 6-7 5-7 11M24 36v2", stroke: "own", "stroke-width": 4.5 }]],
};

/** Make an SVG element. */
export function svg(name, attributes = {}, ...children) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

/** Return the shapes of a state's sign, in its colours. */
export function sign(state, ownColor = state.color) {
  return SHAPES[state.sign].map(([name, given]) => {
    const shape = svg(name, { fill: "none", "stroke-linecap": "round", "stroke-linejoin": "round", ...given });
    for (const key of ["fill", "stroke"]) {
      if (given[key] === "own") shape.setAttribute(key, ownColor);
      if (given[key] === "ink") shape.setAttribute(key, state.ink);
    }
    return shape;
  });
}

/** Make a checkbox with its words, kept in the browser's memory under `key` if that is given. */
export function toggle(words, checked, onChange, key = "") {
  const box = Object.assign(document.createElement("input"), { type: "checkbox" });
  const kept = key && localStorage.getItem(key);
  box.checked = kept ? kept === "1" : checked;
  box.addEventListener("change", () => {
    if (key) localStorage.setItem(key, box.checked ? "1" : "0");
    onChange(box.checked);
  });
  const label = document.createElement("label");
  label.append(box, words);
  onChange(box.checked);
  return label;
}
