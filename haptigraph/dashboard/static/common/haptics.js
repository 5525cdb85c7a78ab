/** The present haptic level, as the guard sent it to the device; silent as soon as the loop's data are stale. */

const SILENCE = { amplitude: 0, frequency_hz: 0 };

export class Haptics {
  received_ms = -Infinity; timer = 0;
  /** @type {HapticLevel} */ level = SILENCE;
  /** @type {HapticOutput[]} */ outputs = [];

  /** @param {number} stale_ms after so long without an image, all outputs are silenced */
  constructor(stale_ms) { this.stale_ms = stale_ms; }

  add(/** @type {HapticOutput} */ output) { this.outputs.push(output); }

  /** An image has arrived, so the last level is still valid. */
  keepAlive(now_ms = performance.now()) { this.received_ms = now_ms; this.play(now_ms); }

  /** Take the levels that the device received, oldest first. @param {HapticEdge[]} edges */
  setLevel(edges, now_ms = performance.now()) {
    const [, amplitude, frequency_hz] = edges[edges.length - 1];
    this.level = { amplitude, frequency_hz };
    this.play(now_ms);
  }

  /** Stay silent until the next image. */
  silence() { this.received_ms = -Infinity; this.play(performance.now()); }

  play(/** @type {number} */ now_ms) {
    const until_ms = this.received_ms + this.stale_ms;
    const isOn = this.level.amplitude > 0 && now_ms < until_ms && !document.hidden;
    for (const output of this.outputs) output.play(isOn ? this.level : SILENCE, until_ms, now_ms);
    clearTimeout(this.timer);
    if (isOn) this.timer = setTimeout(() => this.play(performance.now()), until_ms - now_ms + 1);
  }
}
