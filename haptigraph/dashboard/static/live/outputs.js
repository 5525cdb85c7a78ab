/** A page's outputs of haptic feedback: the controller, a phone's own motor, and as substitutes a border around the page and a tone. */

import { checkbox } from "../common/dom.js";
import { phone } from "./phone.js";
import { Rumble, nameOf } from "./rumble.js";

/** A border around the page, as opaque as the level is strong. */
class ScreenBorder {
  isOn = false;

  enable(/** @type {boolean} */ isOn) { this.isOn = isOn; if (!isOn) this.show(0); }

  play(/** @type {HapticLevel} */ level) { if (this.isOn) this.show(level.amplitude); }

  show(/** @type {number} */ amplitude) {
    const main = /** @type {HTMLElement} */ (document.querySelector("main")), { classList, style } = document.body;
    classList.toggle("vibrating", amplitude > 0);
    style.setProperty("--amplitude", String(amplitude));
    style.setProperty("--border", getComputedStyle(main).getPropertyValue("--state"));
  }
}

/** A tone, an octave above the vibration so that small loudspeakers can play it. */
class Tone {
  isOn = false;
  /** @type {AudioContext | null} */ audio = null;
  /** @type {GainNode} */ gain;
  /** @type {OscillatorNode} */ voice;

  /** Switch on or off; browsers play sound only after a click. @param {boolean} isOn */
  enable(isOn) {
    this.isOn = isOn;
    if (isOn) (this.audio ??= this.build()).resume();
    else if (this.audio) this.gain.gain.setTargetAtTime(0, this.audio.currentTime, 0.005);
  }

  build() {
    const audio = new AudioContext();
    this.gain = new GainNode(audio, { gain: 0 });
    this.voice = new OscillatorNode(audio, { type: "triangle" });
    this.voice.connect(this.gain).connect(audio.destination);
    this.voice.start();
    return audio;
  }

  play(/** @type {HapticLevel} */ level) {
    if (!this.isOn || !this.audio) return;
    const now = this.audio.currentTime;
    if (level.amplitude) this.voice.frequency.setTargetAtTime(2 * level.frequency_hz, now, 0.002);
    this.gain.gain.setTargetAtTime(0.4 * level.amplitude, now, 0.005);
  }
}

/** @typedef {{ names: () => string[], rumble: Rumble }} Outputs the outputs that work at present, and the controller's */

/** Let a page play haptic feedback, with a switch for each output.
 *  @returns {Outputs}
 *  @param {import("../common/haptics.js").Haptics} haptics @param {import("./gamepad.js").Controller} controller @param {HTMLElement} fieldset */
export function addOutputs(haptics, controller, fieldset) {
  const rumble = new Rumble(() => controller.pad()), motor = new Rumble(() => phone), border = new ScreenBorder(), tone = new Tone();
  for (const output of [rumble, motor, border, tone]) haptics.add(output);
  fieldset.append(
    checkbox("controller", true, (isOn) => rumble.enable(isOn), "touch-controller"),
    ...(phone ? [checkbox("phone", false, (isOn) => motor.enable(isOn))] : []),  // browsers let it vibrate only after a touch
    checkbox("screen", false, (isOn) => border.enable(isOn), "touch-screen"),
    checkbox("sound", false, (isOn) => tone.enable(isOn)),
  );
  return { rumble, names: () => [
    ...(rumble.isReady ? [`controller: ${nameOf(controller.pad())}`] : []), ...(phone && motor.isOn ? ["phone"] : []),
    ...(border.isOn ? ["screen"] : []), ...(tone.isOn && tone.audio?.state === "running" ? ["sound"] : []),
  ] };
}
