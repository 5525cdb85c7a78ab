/** What the hand feels now, as this page knows it: what the guard told the device, and nothing that is stale. */

export class Touch {
  /** @param {number} stale_ms without news of the loop for so long, everything is silent */
  constructor(stale_ms) {
    this.stale_ms = stale_ms;
    this.level = { amplitude: 0, frequency_hz: 0 };
    this.heard_ms = -Infinity;
    this.outputs = [];
    this.timer = 0;
  }

  /** Let an output play: `play(level, until_ms)`; a level of 0 is silence at once. */
  add(output) { this.outputs.push(output); }

  /** Take news of the loop: an image has arrived, so the last level still counts. */
  fresh(now_ms = performance.now()) {
    this.heard_ms = now_ms;
    this.play(now_ms);
  }

  /** Take what the device was told: [time_ms, amplitude, frequency_hz] each, oldest first. */
  told(edges, now_ms = performance.now()) {
    const [, amplitude, frequency_hz] = edges.at(-1);
    this.level = { amplitude, frequency_hz };
    this.play(now_ms);
  }

  /** Silence, until there is news again. */
  silence() {
    this.heard_ms = -Infinity;
    this.play(performance.now());
  }

  play(now_ms) {
    const until_ms = this.heard_ms + this.stale_ms;
    const isOn = this.level.amplitude > 0 && now_ms < until_ms && !document.hidden;
    const level = isOn ? this.level : { amplitude: 0, frequency_hz: 0 };
    for (const output of this.outputs) output.play(level, until_ms, now_ms);
    clearTimeout(this.timer);
    if (isOn) this.timer = setTimeout(() => this.play(performance.now()), until_ms - now_ms + 1);
  }
}
