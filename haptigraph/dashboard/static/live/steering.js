/** Steering from the page: input of keyboard, mouse and controller becomes motion of the hand, in messages. */

import { Keyboard, Mouse } from "./inputs.js";

const TICK_MS = 16, SPEED_MM_S = 30, FINE = 0.25, MAX_TICK_S = 0.1;

export class Steering {
  isHolder = false;
  /** Whether a key or stick moves the instrument only while the clutch is held. */
  needsClutch = false;
  /** Whether the instrument has jaws. */
  hasJaws = false; engaged = false;
  ticked_ms = performance.now();
  filterWasDown = false;
  /** Called when the controller's button for the tremor filter is pressed. */
  onFilter = () => {};

  /** @param {Send} send @param {import("./gamepad.js").Controller} controller @param {HTMLElement} surface where the mouse drags */
  constructor(send, controller, surface) {
    this.send = send; this.controller = controller;
    this.keyboard = new Keyboard(() => this.isHolder);
    this.mouse = new Mouse(surface);
    setInterval(() => this.tick(), TICK_MS);
  }

  /** Steer another run. @param {Hello} hello */
  begin({ has_jaws = false }) { this.hasJaws = has_jaws; this.keyboard.begin(has_jaws); }

  /** Disengage, until something is pressed again. */
  release() {
    this.keyboard.release();
    this.mouse.isDown = false;
    if (this.engaged) this.sendMotion(false, 0, 0, 0);
  }

  tick(now_ms = performance.now()) {
    const elapsed_s = Math.min((now_ms - this.ticked_ms) / 1000, MAX_TICK_S);
    this.ticked_ms = now_ms;
    const keys = this.keyboard.read(), stick = this.controller.read(), drag = this.mouse.read();
    if (!this.isHolder || document.hidden) return;
    if (stick.filter && !this.filterWasDown) this.onFilter();
    this.filterWasDown = stick.filter;
    const step_mm = SPEED_MM_S * elapsed_s * (keys.fine || stick.fine ? FINE : 1);
    const along_mm = (keys.along + stick.along) * step_mm + drag.along_mm;
    const across_mm = (keys.across + stick.across) * step_mm + drag.across_mm;
    const apart_mm = this.hasJaws ? (keys.apart + Number(stick.open) - Number(stick.close)) * step_mm : 0;
    const clutch = keys.clutch || stick.clutch || drag.clutch;
    const engaged = clutch || (!this.needsClutch && (along_mm !== 0 || across_mm !== 0 || apart_mm !== 0));
    if (engaged) this.sendMotion(true, along_mm, across_mm, apart_mm);
    else if (this.engaged) this.sendMotion(false, 0, 0, 0);
  }

  /** @param {boolean} engaged @param {number} along_mm @param {number} across_mm @param {number} apart_mm */
  sendMotion(engaged, along_mm, across_mm, apart_mm) {
    this.engaged = engaged;
    this.send({ type: "motion", hand: { engaged, along_mm, across_mm, apart_mm } });
  }
}
