/** Steering from the page: input of keyboard, mouse and controller becomes motion of the hand, in messages. */

import { Keyboard, Mouse } from "./inputs.js";

const TICK_MS = 16, SPEED_MM_S = 30, FINE = 0.25, MAX_TICK_S = 0.1;

export class Steering {
  isHolder = false;
  /** Whether a key or stick moves the instrument only while the clutch is held. */
  needsClutch = false;
  /** Whether the instrument has jaws. */
  hasJaws = false; engaged = false;
  /** Whether a real robot is steered: it moves only while a dead-man is held. */
  isRobot = false;
  /** Whether the button for it is held. */
  isHeld = false;
  /** Whether all of them must be let go before one counts. */
  mustRelease = true;
  ticked_ms = performance.now();
  filterWasDown = false;
  /** Called when the controller's button for the tremor filter is pressed. */
  onFilter = () => {};

  /** @param {Send} send @param {import("./gamepad.js").Controller} controller @param {HTMLElement} surface where the mouse drags
   *  @param {import("../common/clock.js").ServerClock} clock stamps the messages */
  constructor(send, controller, surface, clock) {
    this.send = send; this.controller = controller; this.clock = clock;
    this.keyboard = new Keyboard(() => this.isHolder);
    this.mouse = new Mouse(surface);
    addEventListener("blur", () => { if (this.isRobot) this.release(); });
    setInterval(() => this.tick(), TICK_MS);
  }

  /** Steer another run. @param {Hello} hello */
  begin({ has_jaws = false, robot = "" }) {
    this.hasJaws = has_jaws; this.isRobot = robot !== "";
    this.keyboard.begin(has_jaws, this.isRobot);
  }

  /** Disengage, until something is pressed again. */
  release() {
    this.keyboard.release();
    this.mouse.isDown = this.isHeld = false;
    this.mustRelease = true;
    if (this.engaged) this.sendMotion(false);
  }

  tick(now_ms = performance.now()) {
    const elapsed_s = Math.min((now_ms - this.ticked_ms) / 1000, MAX_TICK_S);
    this.ticked_ms = now_ms;
    const keys = this.keyboard.read(), stick = this.controller.read(), drag = this.mouse.read();
    const isHeld = keys.clutch || stick.clutch || drag.clutch || this.isHeld;
    if (!isHeld) this.mustRelease = false;
    if (!this.isHolder || document.hidden) return;
    if (stick.filter && !this.filterWasDown) this.onFilter();
    this.filterWasDown = stick.filter;
    const step_mm = SPEED_MM_S * elapsed_s * (keys.fine || stick.fine ? FINE : 1);
    const along_mm = (keys.along + stick.along) * step_mm + drag.along_mm;
    const across_mm = (keys.across + stick.across) * step_mm + drag.across_mm;
    const apart_mm = this.hasJaws ? (keys.apart + Number(stick.open) - Number(stick.close)) * step_mm : 0;
    const outwards_mm = this.isRobot ? (keys.outwards + stick.outwards) * step_mm : 0;
    const moves = !this.needsClutch && (along_mm !== 0 || across_mm !== 0 || apart_mm !== 0);
    const engaged = this.isRobot ? isHeld && !this.mustRelease && document.hasFocus() : isHeld || moves;
    if (engaged) this.sendMotion(true, along_mm, across_mm, apart_mm, outwards_mm);
    else if (this.engaged) this.sendMotion(false);
  }

  /** @param {boolean} engaged */
  sendMotion(engaged, along_mm = 0, across_mm = 0, apart_mm = 0, outwards_mm = 0) {
    const sent_ms = this.clock.stamp_ms();
    this.engaged = engaged;
    this.send({ type: "motion", hand: { engaged, along_mm, across_mm, apart_mm, outwards_mm }, sent_ms: sent_ms >= 0 ? sent_ms : null });
  }
}
