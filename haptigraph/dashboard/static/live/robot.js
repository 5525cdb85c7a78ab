/** The panel of a real robot: its state, why it is held, its enable switch, and the button to hold while it moves. */

import { $, setText } from "../common/dom.js";

const SILENT_MS = 1000;

export class Robot {
  /** @type {RobotStatus | null} */ status = null;
  /** Why this page may not move the robot; empty if it may. */
  refusal = "";
  received_ms = -Infinity;

  /** @param {Send} send @param {import("./steering.js").Steering} steering */
  constructor(send, steering) {
    this.steering = steering;
    const button = $("deadman"), hold = (/** @type {boolean} */ isHeld) => { steering.isHeld = isHeld; };
    $("robot-switch").addEventListener("click", () => {
      send({ type: "switch_robot", on: !(this.status?.is_switched_on ?? true) });
      $("robot-switch").blur();  // so that Space is the dead-man again
    });
    button.addEventListener("pointerdown", (event) => { button.setPointerCapture(event.pointerId); hold(true); });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) button.addEventListener(end, () => hold(false));
    button.addEventListener("contextmenu", (event) => event.preventDefault());  // which a long press opens
    button.addEventListener("keydown", (event) => { if (event.code === "Space" && !event.repeat) hold(true); });
    button.addEventListener("keyup", (event) => { if (event.code === "Space") hold(false); });
  }

  begin(/** @type {Hello} */ { robot = "" }) {
    this.status = null;
    $("robot").hidden = robot === "";
    $("robot-name").textContent = robot;
    document.querySelector("main")?.classList.toggle("with-robot", robot !== "");
  }

  update(/** @type {RobotStatus} */ status) {
    this.status = status;
    this.received_ms = performance.now();
  }

  /** Show the present state; called with every drawing. */
  show() {
    if ($("robot").hidden) return;
    const isKnown = this.status !== null && performance.now() - this.received_ms < SILENT_MS;
    const status = isKnown ? this.status : null, isMoving = status?.is_moving ?? false, { isHolder } = this.steering;
    $("robot").classList.toggle("moving", isMoving);
    $("robot").classList.toggle("unknown", !isKnown);
    setText($("robot-state"), !isKnown ? "? state unknown" : isMoving ? "● moves with your hand" : "■ held");
    const reasons = status ? [...status.reasons, ...(status.error ? [status.error] : [])] : ["nothing is heard from the robot"];
    const text = this.refusal || reasons.join(" · ");
    setText($("robot-reasons"), text);
    setText($("robot-facts"), status ? facts(status) : "");
    const isOn = status?.is_switched_on ?? false;
    setText($("robot-switch"), isOn ? "Disable motion" : "Enable motion");
    $("robot-switch").ariaPressed = String(isOn);
    for (const control of [$("robot-switch"), $("deadman")]) control.disabled = !isHolder;
    $("deadman").classList.toggle("on", this.steering.engaged);
  }
}

/** @param {RobotStatus} status */
function facts({ state, is_homed, tip_mm, rate_hz, late }) {
  const tip = tip_mm ? `tip ${tip_mm.map((each) => each.toFixed(2)).join(", ")} mm` : "pose unknown";
  const ignored = late ? `${late} late messages ignored` : "";
  return [state || "state not reported", is_homed ? "homed" : "not homed", tip, `${rate_hz.toFixed(0)} Hz`, ignored].filter(Boolean).join(" · ");
}
