/** The present haptic level, as the guard sent it to the device; silent as soon as the newest image is too old. */

const SILENCE = { amplitude: 0, frequency_hz: 0 };

export class Haptics {
  captured_ms = -Infinity; timer = 0;
  /** @type {HapticLevel} */ level = SILENCE;
  /** @type {HapticOutput[]} */ outputs = [];

  /** @param {number} stale_ms all outputs are silent once the newest image was captured so long ago */
  constructor(stale_ms) { this.stale_ms = stale_ms; }

  add(/** @type {HapticOutput} */ output) { this.outputs.push(output); }

  /** An image has arrived, so the last level is valid for a while after its capture, however late it comes.
   *  @param {number} captured_ms on this page's clock; NaN while that is not known, which silences */
  keepAlive(captured_ms, now_ms = performance.now()) {
    // Where the clocks are not yet known well, an image may seem to come from the future.
    this.captured_ms = Number.isNaN(captured_ms) ? -Infinity : Math.min(captured_ms, now_ms);
    this.play(now_ms);
  }

  /** Take the levels that the device received, oldest first. @param {HapticEdge[]} edges */
  setLevel(edges, now_ms = performance.now()) {
    const [, amplitude, frequency_hz] = edges[edges.length - 1];
    this.level = { amplitude, frequency_hz };
    this.play(now_ms);
  }

  /** Stay silent until the next image. */
  silence() { this.captured_ms = -Infinity; this.play(performance.now()); }

  play(/** @type {number} */ now_ms) {
    const until_ms = this.captured_ms + this.stale_ms;
    const isOn = this.level.amplitude > 0 && now_ms < until_ms && !document.hidden;
    for (const output of this.outputs) output.play(isOn ? this.level : SILENCE, until_ms, now_ms);
    clearTimeout(this.timer);
    if (isOn) this.timer = setTimeout(() => this.play(performance.now()), until_ms - now_ms + 1);
  }
}
