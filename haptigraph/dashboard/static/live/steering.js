/** Steering from the page: what keyboard, mouse and controller want becomes motion of the hand, in messages. */

import { Keyboard, Mouse } from "./inputs.js";

const TICK_MS = 16, SPEED_MM_S = 30, FINE = 0.25, LONGEST_STEP_S = 0.1;

export class Steering {
  /**
   * @param {(message: any) => void} send
   * @param {import("./gamepad.js").Controller} controller
   * @param {HTMLElement} surface where the mouse drags
   */
  constructor(send, controller, surface) {
    this.send = send;
    this.controller = controller;
    this.keyboard = new Keyboard(() => this.isHolder);
    this.mouse = new Mouse(surface);
    this.isHolder = false;
    /** Whether a key or stick moves the needle only while the clutch is held. */
    this.needsClutch = false;
    /** Whether the tool has jaws to open and close. */
    this.hasJaws = false;
    this.engaged = false;
    this.then_ms = performance.now();
    this.filterWasDown = false;
    /** Called when the controller's button for the tremor filter goes down. */
    this.onFilter = () => {};
    setInterval(() => this.tick(), TICK_MS);
  }

  /** Steer what a run is about. */
  begin({ has_jaws }) {
    this.hasJaws = has_jaws;
    this.keyboard.begin(has_jaws);
  }

  /** Let go: nothing more is sent until something is pressed anew. */
  letGo() {
    this.keyboard.letGo();
    this.mouse.isDown = false;
    if (this.engaged) this.tell(false, 0, 0, 0);
  }

  tick(now_ms = performance.now()) {
    const elapsed_s = Math.min((now_ms - this.then_ms) / 1000, LONGEST_STEP_S);
    this.then_ms = now_ms;
    const keys = this.keyboard.read(), stick = this.controller.read(), drag = this.mouse.read();
    if (!this.isHolder || document.hidden) return;
    if (stick.filter && !this.filterWasDown) this.onFilter();
    this.filterWasDown = stick.filter;
    const way_mm = SPEED_MM_S * elapsed_s * (keys.fine || stick.fine ? FINE : 1);
    const along_mm = (keys.along + stick.along) * way_mm + drag.along_mm;
    const across_mm = (keys.across + stick.across) * way_mm + drag.across_mm;
    const apart_mm = this.hasJaws ? (keys.apart + stick.open - stick.close) * way_mm : 0;
    const clutch = keys.clutch || stick.clutch || drag.clutch;
    const engaged = clutch || (!this.needsClutch && (along_mm !== 0 || across_mm !== 0 || apart_mm !== 0));
    if (engaged) this.tell(true, along_mm, across_mm, apart_mm);
    else if (this.engaged) this.tell(false, 0, 0, 0);
  }

  tell(engaged, along_mm, across_mm, apart_mm) {
    this.engaged = engaged;
    this.send({ type: "motion", hand: { engaged, along_mm, across_mm, apart_mm } });
  }
}
