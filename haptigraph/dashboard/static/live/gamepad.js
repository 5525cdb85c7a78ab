/** A game controller as an input, with a mapping of axes and buttons that the browser remembers per controller. */

/** @type {Record<Action, ActionInfo>} */
export const ACTIONS = {
  along: { label: "into the eye", kind: "axis" },
  across: { label: "to the right", kind: "axis" },
  clutch: { label: "clutch", kind: "button" },
  fine: { label: "fine motion", kind: "button" },
  filter: { label: "tremor filter on or off", kind: "button" },
  open: { label: "open the jaws", kind: "button", needsJaws: true },
  close: { label: "close the jaws", kind: "button", needsJaws: true },
  outwards: { label: "out of the picture", kind: "axis", needsRobot: true },
};
/** @type {Mapping} */ const DEFAULT_MAPPING = {
  along: { index: 1, sign: 1 }, across: { index: 0, sign: 1 },
  clutch: { index: 7 }, fine: { index: 6 }, filter: { index: 3 },
  open: { index: 5 }, close: { index: 4 }, outwards: { index: 3, sign: 1 },
};
const DEAD_ZONE = 0.12, PRESSED = 0.35, MOVED = 0.6;

export class Controller {
  id = "";
  mapping = structuredClone(DEFAULT_MAPPING);

  /** Return the first connected controller, or null. */
  pad() {
    const pad = [...navigator.getGamepads?.() ?? []].find((each) => each?.connected) ?? null;
    if (pad && pad.id !== this.id) this.load(pad.id);
    return pad;
  }

  /** Read the controller's input; zero and false without a controller. */
  read(pad = this.pad()) {
    const axis = (/** @type {ControllerInput} */ { index, sign = 1 }) => shaped(pad?.axes[index] ?? 0) * sign;
    const button = (/** @type {ControllerInput} */ { index }) => (pad?.buttons[index]?.value ?? 0) > PRESSED;
    const { along, across, outwards, clutch, fine, filter, open, close } = this.mapping;
    return { along: axis(along), across: axis(across), outwards: axis(outwards), clutch: button(clutch), fine: button(fine), filter: button(filter), open: button(open), close: button(close) };
  }

  /** Map an axis or a button to an action. @param {Action} action @param {ControllerInput} input */
  assign(action, input) {
    this.mapping[action] = input;
    localStorage.setItem(`controller ${this.id}`, JSON.stringify(this.mapping));
  }

  /** Restore the default mapping. */
  reset() {
    this.mapping = structuredClone(DEFAULT_MAPPING);
    localStorage.removeItem(`controller ${this.id}`);
  }

  load(/** @type {string} */ id) {
    this.id = id;
    this.mapping = { ...structuredClone(DEFAULT_MAPPING), ...stored(id) };
  }
}

/** Return the input that has moved most since the controller was at rest, or null.
 *  @param {Gamepad} pad @param {PadValues} rest @param {ActionInfo["kind"]} kind
 *  @returns {ControllerInput | null} */
export function movedInput(pad, rest, kind) {
  if (kind === "button") {
    const index = pad.buttons.findIndex((button, at) => button.value > MOVED && !(rest.buttons[at] > MOVED));
    return index < 0 ? null : { index };
  }
  const changes = pad.axes.map((value, at) => value - rest.axes[at]);
  const index = changes.reduce((largest, change, at) => (Math.abs(change) > Math.abs(changes[largest]) ? at : largest), 0);
  return Math.abs(changes[index]) > MOVED ? { index, sign: Math.sign(changes[index]) } : null;
}

/** Shape a stick's value: a dead zone in the middle, fine near it, full scale at its end. @param {number} value */
function shaped(value) {
  const size = Math.min(Math.max((Math.abs(value) - DEAD_ZONE) / (1 - DEAD_ZONE), 0), 1);
  return Math.sign(value) * size * (0.4 + 0.6 * size);
}

/** @param {string} id @returns {Partial<Mapping>} */
function stored(id) {
  try { return JSON.parse(localStorage.getItem(`controller ${id}`) ?? "{}"); } catch { return {}; }
}
