/** Moves through a run: by keys, and in real time. Knows only numbers of steps. */

export class Player {
  /**
   * @param {(number: number) => void} onSeek
   * @param {(isPlaying: boolean) => void} onPlay
   */
  constructor(onSeek, onPlay) {
    Object.assign(this, { onSeek, onPlay, run: null, number: 0, begun: null });
    document.addEventListener("keydown", (event) => this.press(event));
  }

  begin(run) { this.pause(); this.run = run; this.number = 0; }

  /** Go to a step. */
  seek(number) {
    this.number = Math.min(Math.max(number, 0), this.run.length - 1);
    this.onSeek(this.number);
  }

  /** Go to a moment, and on from there if it is playing. */
  seekTime(time_ms) {
    if (this.begun) this.begun = { now_ms: performance.now(), from_ms: time_ms };
    this.seek(this.run.numberAt(time_ms));
  }

  toggle() { if (this.begun) this.pause(); else this.play(); }

  play() {
    const isAtEnd = this.number === this.run.length - 1;
    this.begun = { now_ms: performance.now(), from_ms: isAtEnd ? 0 : this.run.time_ms[this.number] };
    this.onPlay(true);
    requestAnimationFrame(() => this.go());
  }

  pause() {
    this.begun = null;
    this.onPlay(false);
  }

  go() {
    if (!this.begun) return;
    const time_ms = this.begun.from_ms + performance.now() - this.begun.now_ms;
    const number = this.run.numberAt(time_ms);
    if (number !== this.number) this.seek(number);
    if (time_ms >= this.run.end_ms) this.pause(); else requestAnimationFrame(() => this.go());
  }

  press(event) {
    if (!this.run || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target.matches?.("input, select, textarea") || (event.code === "Space" && event.target.matches?.("button, a"))) return;
    const now_ms = this.run.time_ms[this.number], far = event.shiftKey;
    const act = {
      ArrowLeft: () => (far ? this.jump(now_ms - 1000) : this.step(-1)),
      ArrowRight: () => (far ? this.jump(now_ms + 1000) : this.step(1)),
      Home: () => this.jump(0),
      End: () => this.jump(this.run.end_ms),
      Space: () => this.toggle(),
    }[event.code];
    if (!act) return;
    event.preventDefault();
    act();
  }

  step(by) { this.pause(); this.seek(this.number + by); }
  jump(time_ms) { this.seekTime(Math.min(Math.max(time_ms, 0), this.run.end_ms)); }
}
