/** Keyboard and mouse as inputs. They keep what is held and what was dragged; they send nothing. */

const KEYS = {
  ArrowDown: ["along", 1], KeyS: ["along", 1], ArrowUp: ["along", -1], KeyW: ["along", -1],
  ArrowRight: ["across", 1], KeyD: ["across", 1], ArrowLeft: ["across", -1], KeyA: ["across", -1],
  Space: ["clutch", 1],
};
const JAWS = { KeyO: ["apart", 1], KeyC: ["apart", -1] };
export const MM_PER_PX = 0.25;

/** Keys that are held: {along, across, apart} in -1, 0, 1, clutch and fine. */
export class Keyboard {
  /** @param {() => boolean} counts whether keys steer now; otherwise they are the page's */
  constructor(counts) {
    this.counts = counts;
    this.keys = KEYS;
    this.held = new Set();
    this.fine = false;
    addEventListener("keydown", (event) => this.press(event));
    addEventListener("keyup", (event) => { this.held.delete(event.code); this.fine = event.shiftKey; });
    addEventListener("blur", () => this.letGo());
  }

  /** Let keys open and close jaws where there are some; elsewhere they are the page's. */
  begin(hasJaws) {
    this.letGo();
    this.keys = hasJaws ? { ...KEYS, ...JAWS } : KEYS;
  }

  press(event) {
    this.fine = event.shiftKey;
    if (!this.counts() || !this.keys[event.code] || event.ctrlKey || event.metaKey || event.altKey) return;
    if (isForTheField(event.target, event.code) || document.querySelector("dialog[open]")) return;
    event.preventDefault();
    this.held.add(event.code);
  }

  letGo() { this.held.clear(); this.fine = false; }

  read() {
    const wants = { along: 0, across: 0, apart: 0, clutch: 0 };
    for (const code of this.held) wants[this.keys[code][0]] += this.keys[code][1];
    const { along, across, apart } = wants;
    return { along: Math.sign(along), across: Math.sign(across), apart: Math.sign(apart), clutch: wants.clutch > 0, fine: this.fine };
  }
}

/** Dragging over the picture: the hand's way since last asked [mm], while a button is down. */
export class Mouse {
  /** @param {HTMLElement} surface */
  constructor(surface) {
    this.isDown = false;
    this.x = this.y = 0;
    surface.style.touchAction = "none";
    surface.addEventListener("pointerdown", (event) => { this.isDown = true; surface.setPointerCapture(event.pointerId); });
    surface.addEventListener("pointermove", (event) => { if (this.isDown) { this.x += event.movementX; this.y += event.movementY; } });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) surface.addEventListener(end, () => { this.isDown = false; });
  }

  read() {
    const wants = { along_mm: this.y * MM_PER_PX, across_mm: this.x * MM_PER_PX, clutch: this.isDown };
    this.x = this.y = 0;
    return wants;
  }
}

/** Tell whether a key belongs to what has the focus: arrows to a slider, space to a button. */
function isForTheField(target, code) {
  if (target.matches?.("input[type=range], select, textarea, input[type=text], input[type=number]")) return true;
  return code === "Space" && Boolean(target.matches?.("button, input, a, summary"));
}
