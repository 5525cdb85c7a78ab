/** Keyboard and mouse as inputs: which keys are held, how far the mouse was dragged. */

/** @type {KeyMap} */ const KEYS = {
  ArrowDown: ["along", 1], KeyS: ["along", 1], ArrowUp: ["along", -1], KeyW: ["along", -1],
  ArrowRight: ["across", 1], KeyD: ["across", 1], ArrowLeft: ["across", -1], KeyA: ["across", -1],
  Space: ["clutch", 1],
};
/** @type {KeyMap} */ const JAW_KEYS = { KeyO: ["apart", 1], KeyC: ["apart", -1] };
/** @type {KeyMap} */ const ROBOT_KEYS = { KeyR: ["outwards", 1], KeyF: ["outwards", -1] };
const MM_PER_PX = 0.25;

export class Keyboard {
  keys = KEYS;
  /** @type {Set<string>} */ held = new Set();
  fine = false;

  /** @param {() => boolean} isActive whether keys steer; otherwise they keep their meaning on the page */
  constructor(isActive) {
    this.isActive = isActive;
    addEventListener("keydown", (event) => this.press(event));
    addEventListener("keyup", (event) => { this.held.delete(event.code); this.fine = event.shiftKey; });
    addEventListener("blur", () => this.release());
  }

  /** Steer another run. @param {boolean} hasJaws whether keys open and close jaws @param {boolean} isRobot whether they move out of the picture, too */
  begin(hasJaws, isRobot) {
    this.release();
    this.keys = { ...KEYS, ...(hasJaws ? JAW_KEYS : {}), ...(isRobot ? ROBOT_KEYS : {}) };
  }

  press(/** @type {KeyboardEvent} */ event) {
    this.fine = event.shiftKey;
    if (!this.isActive() || !this.keys[event.code] || event.ctrlKey || event.metaKey || event.altKey) return;
    if (isForElement(event.target, event.code) || document.querySelector("dialog[open]")) return;
    event.preventDefault();
    if (!event.repeat) this.held.add(event.code);  // a key that was released by `release` must be pressed again
  }

  release() { this.held.clear(); this.fine = false; }

  /** Return the keys' input: directions in -1, 0, 1; clutch and fine. */
  read() {
    const sums = { along: 0, across: 0, apart: 0, outwards: 0, clutch: 0 };
    for (const [axis, value] of [...this.held].map((code) => this.keys[code])) sums[axis] += value;
    const { along, across, apart, outwards, clutch } = sums;
    return { along: Math.sign(along), across: Math.sign(across), apart: Math.sign(apart), outwards: Math.sign(outwards), clutch: clutch > 0, fine: this.fine };
  }
}

/** Dragging over the picture. */
export class Mouse {
  isDown = false; x = 0; y = 0;

  constructor(/** @type {HTMLElement} */ surface) {
    surface.style.touchAction = "none";
    surface.addEventListener("pointerdown", (event) => { this.isDown = true; surface.setPointerCapture(event.pointerId); });
    surface.addEventListener("pointermove", (event) => { if (this.isDown) { this.x += event.movementX; this.y += event.movementY; } });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) surface.addEventListener(end, () => { this.isDown = false; });
  }

  /** Return the motion since the last call [mm], and whether a button is down. */
  read() {
    const input = { along_mm: this.y * MM_PER_PX, across_mm: this.x * MM_PER_PX, clutch: this.isDown };
    this.x = this.y = 0;
    return input;
  }
}

/** Return whether a key belongs to the focused element: arrows to a slider, space to a button. @param {EventTarget | null} target @param {string} code */
function isForElement(target, code) {
  if (!(target instanceof Element)) return false;
  if (target.matches("input[type=range], select, textarea, input[type=text], input[type=number]")) return true;
  return code === "Space" && target.matches("button, input, a, summary");
}
