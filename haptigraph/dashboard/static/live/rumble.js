/** Touch on a game controller, through the browser's dual-rumble.
 *
 * An effect never outlasts the news it came from, so that it ends by itself if this page dies. Commands keep
 * 50 ms apart, for there are controllers that crash otherwise; silence never waits.
 */

export const LEAST_GAP_MS = 50, RESEND_MS = 60, HIGH_HZ = 120;

export class Rumble {
  /** @param {() => (Gamepad | null)} find returns the controller to play on */
  constructor(find) {
    this.find = find;
    this.isOn = true;
    this.problem = "";
    this.playing = null;
    this.sent_ms = -Infinity;
    this.timer = 0;
  }

  /** Switch touch on the controller on or off. */
  enable(isOn) { this.isOn = isOn; if (!isOn) this.stop(); }

  play(level, until_ms, now_ms = performance.now()) {
    clearTimeout(this.timer);
    if (!level.amplitude || !this.isOn) { this.stop(); return; }
    const changed = this.playing?.amplitude !== level.amplitude || this.playing?.frequency_hz !== level.frequency_hz;
    const wait_ms = this.sent_ms + (changed ? LEAST_GAP_MS : RESEND_MS) - now_ms;
    if (wait_ms > 0) {
      if (changed) this.timer = setTimeout(() => this.play(level, until_ms), wait_ms);
      return;
    }
    const duration = Math.floor(until_ms - now_ms);
    if (duration > 0) this.send(level, duration);
  }

  send(level, duration) {
    const actuator = actuatorOf(this.find());
    if (!actuator) return;
    this.playing = level;
    this.actuator = actuator;
    const effect = { startDelay: 0, duration, ...motors(level) };
    Promise.resolve(actuator.playEffect("dual-rumble", effect)).then(() => { this.problem = ""; }, (error) => { this.problem = String(error); });
    this.sent_ms = performance.now();
  }

  stop() {
    clearTimeout(this.timer);
    if (!this.playing) return;
    this.playing = null;
    this.sent_ms = performance.now();
    Promise.resolve(this.actuator.reset()).catch((error) => { this.problem = String(error); });
  }
}

/** Return what can rumble in a controller, or null. */
export function actuatorOf(gamepad) {
  const actuator = gamepad?.vibrationActuator;
  if (!actuator?.playEffect) return null;
  return !actuator.effects || actuator.effects.includes("dual-rumble") ? actuator : null;
}

/** Share a level between the motors: the large one for what is low, both for what is high. */
export function motors({ amplitude, frequency_hz }) {
  return { strongMagnitude: amplitude, weakMagnitude: frequency_hz >= HIGH_HZ ? amplitude : 0 };
}
