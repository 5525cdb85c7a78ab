/** Haptic feedback on a game controller, through the browser's dual-rumble.
 *
 * An effect ends when the data it is based on become stale, so that it ends by itself if this page dies. Commands
 * are at least 50 ms apart, because some controllers crash otherwise; silence never waits.
 */

const MIN_GAP_MS = 50, RESEND_MS = 60, HIGH_HZ = 120;

export class Rumble {
  isOn = true; problem = "";
  /** @type {HapticLevel | null} */ playing = null;
  /** @type {GamepadHapticActuator | null} */ actuator = null;
  sent_ms = -Infinity; timer = 0;
  /** Called when the browser confirms that an effect was played. @type {(start_ms: number, end_ms: number) => void} */ onPlayed = () => {};

  /** @param {() => (Pick<Gamepad, "vibrationActuator"> | null)} find returns the controller to play on */
  constructor(find) { this.find = find; }

  enable(/** @type {boolean} */ isOn) { this.isOn = isOn; if (!isOn) this.stop(); }

  /** Whether it can play at present. */
  get isReady() { return this.isOn && actuatorOf(this.find()) !== null; }

  /** @param {HapticLevel} level @param {number} until_ms @param {number} [now_ms] */
  play(level, until_ms, now_ms = performance.now()) {
    clearTimeout(this.timer);
    if (!level.amplitude || !this.isOn) { this.stop(); return; }
    const hasChanged = this.playing?.amplitude !== level.amplitude || this.playing?.frequency_hz !== level.frequency_hz;
    const wait_ms = this.sent_ms + (hasChanged ? MIN_GAP_MS : RESEND_MS) - now_ms;
    if (wait_ms > 0) {
      if (hasChanged) this.timer = setTimeout(() => this.play(level, until_ms), wait_ms);
      return;
    }
    const duration = Math.floor(until_ms - now_ms);
    if (duration > 0) this.send(level, duration);
  }

  /** @param {HapticLevel} level @param {number} duration [ms] */
  send(level, duration) {
    const actuator = actuatorOf(this.find());
    if (!actuator) return;
    this.playing = level;
    this.actuator = actuator;
    const effect = { startDelay: 0, duration, ...magnitudes(level) };
    const start_ms = this.sent_ms = performance.now();
    Promise.resolve(actuator.playEffect("dual-rumble", effect)).then((result) => {
      this.problem = "";
      this.onPlayed(start_ms, result === "complete" ? start_ms + duration : Math.min(performance.now(), start_ms + duration));
    }, (error) => { this.problem = String(error); });
  }

  stop() {
    clearTimeout(this.timer);
    if (!this.playing) return;
    this.playing = null;
    this.sent_ms = performance.now();
    Promise.resolve(this.actuator?.reset()).catch((error) => { this.problem = String(error); });
  }
}

/** Return the actuator of a controller, or null if it cannot rumble. @param {Pick<Gamepad, "vibrationActuator"> | null} gamepad */
function actuatorOf(gamepad) {
  const actuator = /** @type {GamepadHapticActuator & { effects?: string[] } | null | undefined} */ (gamepad?.vibrationActuator);
  if (!actuator?.playEffect) return null;
  return !actuator.effects || actuator.effects.includes("dual-rumble") ? actuator : null;
}

/** Return the short name of a controller. @param {Gamepad | null} pad */
export function nameOf(pad) { return pad?.id.replace(/\s*\(.*\)/, "").replace(/[+\s]+/g, " ").trim().slice(0, 80) || "Controller"; }

/** Describe a controller in a line. @param {Gamepad | null} pad */
export function controllerText(pad) {
  if (!pad) return isSecureContext ? "No controller: press one of its buttons to connect it" : "No controller: without HTTPS some browsers hide it";
  return `${nameOf(pad)}${actuatorOf(pad) ? ", can vibrate" : ", cannot vibrate: switch on screen or sound"}`;
}

/** Distribute a level over the motors: the large one for low frequencies, both for high ones. @param {HapticLevel} level */
function magnitudes({ amplitude, frequency_hz }) {
  return { strongMagnitude: amplitude, weakMagnitude: frequency_hz >= HIGH_HZ ? amplitude : 0 };
}
