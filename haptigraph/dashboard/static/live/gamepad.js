/** A game controller as an input: which axis and button does what, kept per controller. Sends nothing. */

export const ACTIONS = {
  along: { words: "into the eye", kind: "axis" },
  across: { words: "to the right", kind: "axis" },
  clutch: { words: "clutch", kind: "button" },
  fine: { words: "fine motion", kind: "button" },
  filter: { words: "tremor filter on or off", kind: "button" },
  open: { words: "open the jaws", kind: "button", ofJaws: true },
  close: { words: "close the jaws", kind: "button", ofJaws: true },
};
const STANDARD = {
  along: { index: 1, sign: 1 }, across: { index: 0, sign: 1 },
  clutch: { index: 7 }, fine: { index: 6 }, filter: { index: 3 },
  open: { index: 5 }, close: { index: 4 },
};
const DEAD = 0.12, PRESSED = 0.35;

export class Controller {
  constructor() { this.id = ""; this.mapping = structuredClone(STANDARD); }

  /** Return the controller in use, or null: the first that is connected. */
  pad() {
    const pad = [...navigator.getGamepads()].find((each) => each?.connected) ?? null;
    if (pad && pad.id !== this.id) this.load(pad.id);
    return pad;
  }

  /** Return what the controller wants now; all zero and false where there is none. */
  read(pad = this.pad()) {
    const wants = { along: 0, across: 0, clutch: false, fine: false, filter: false, open: false, close: false };
    if (!pad) return wants;
    for (const [action, { kind }] of Object.entries(ACTIONS)) {
      const { index, sign } = this.mapping[action];
      wants[action] = kind === "axis" ? shaped(pad.axes[index] ?? 0) * sign : (pad.buttons[index]?.value ?? 0) > PRESSED;
    }
    return wants;
  }

  /** Let an axis or a button do something. */
  assign(action, input) {
    this.mapping[action] = input;
    localStorage.setItem(`controller ${this.id}`, JSON.stringify(this.mapping));
  }

  /** Go back to the usual mapping. */
  standard() {
    this.mapping = structuredClone(STANDARD);
    localStorage.removeItem(`controller ${this.id}`);
  }

  load(id) {
    this.id = id;
    this.mapping = { ...structuredClone(STANDARD), ...kept(id) };
  }
}

/** Find what was moved most since `rest`: {index, sign} of an axis, {index} of a button; null if nothing was. */
export function moved(pad, rest, kind) {
  if (kind === "button") {
    const index = pad.buttons.findIndex((button, at) => button.value > 0.6 && !(rest.buttons[at] > 0.6));
    return index < 0 ? null : { index };
  }
  const ways = pad.axes.map((value, at) => value - rest.axes[at]);
  const index = ways.reduce((most, way, at) => (Math.abs(way) > Math.abs(ways[most]) ? at : most), 0);
  return Math.abs(ways[index]) > 0.6 ? { index, sign: Math.sign(ways[index]) } : null;
}

/** Shape a stick: still about its middle, fine near it, full at its end. */
export function shaped(value) {
  const size = Math.min(Math.max((Math.abs(value) - DEAD) / (1 - DEAD), 0), 1);
  return Math.sign(value) * size * (0.4 + 0.6 * size);
}

function kept(id) {
  try { return JSON.parse(localStorage.getItem(`controller ${id}`) ?? "{}"); } catch { return {}; }
}
