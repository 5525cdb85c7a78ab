/** Moves through a run: by keys, and in real time. */

export class Player {
  /** @type {import("./run.js").Run | null} */ run = null;
  number = 0;
  /** When playing began, on the page's clock, and at which time of the run. @type {{ now_ms: number, from_ms: number } | null} */ started = null;

  constructor(/** @type {(number: number) => void} */ onSeek, /** @type {(isPlaying: boolean) => void} */ onPlay) {
    this.onSeek = onSeek; this.onPlay = onPlay;
    document.addEventListener("keydown", (event) => { if (this.run) this.press(event, this.run); });
  }

  begin(/** @type {import("./run.js").Run} */ run) { this.pause(); this.run = run; this.number = 0; }

  /** Go to a step. @param {number} number */
  seek(number) {
    if (!this.run) return;
    this.number = Math.min(Math.max(number, 0), this.run.length - 1);
    this.onSeek(this.number);
  }

  /** Go to a time, and continue to play from there. @param {number} time_ms */
  seekTime(time_ms) {
    if (this.started) this.started = { now_ms: performance.now(), from_ms: time_ms };
    if (this.run) this.seek(this.run.numberAt(time_ms));
  }

  toggle() { if (this.started) this.pause(); else this.play(); }

  play() {
    if (!this.run) return;
    const isAtEnd = this.number === this.run.length - 1;
    this.started = { now_ms: performance.now(), from_ms: isAtEnd ? 0 : this.run.time_ms[this.number] };
    this.onPlay(true);
    requestAnimationFrame(() => this.advance());
  }

  pause() { this.started = null; this.onPlay(false); }

  advance() {
    if (!this.started || !this.run) return;
    const time_ms = this.started.from_ms + performance.now() - this.started.now_ms;
    const number = this.run.numberAt(time_ms);
    if (number !== this.number) this.seek(number);
    if (time_ms >= this.run.end_ms) this.pause(); else requestAnimationFrame(() => this.advance());
  }

  press(/** @type {KeyboardEvent} */ event, /** @type {import("./run.js").Run} */ run) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const target = event.target instanceof Element ? event.target : document.body;
    if (target.matches("input, select, textarea") || (event.code === "Space" && target.matches("button, a"))) return;
    const now_ms = run.time_ms[this.number], isFar = event.shiftKey;
    const jump = (/** @type {number} */ time_ms) => this.seekTime(Math.min(Math.max(time_ms, 0), run.end_ms));
    const step = (/** @type {number} */ by) => { this.pause(); this.seek(this.number + by); };
    /** @type {Record<string, () => void>} */ const actions = {
      ArrowLeft: () => (isFar ? jump(now_ms - 1000) : step(-1)),
      ArrowRight: () => (isFar ? jump(now_ms + 1000) : step(1)),
      Home: () => jump(0),
      End: () => jump(run.end_ms),
      Space: () => this.toggle(),
    };
    if (!actions[event.code]) return;
    event.preventDefault();
    actions[event.code]();
  }
}
