/** Bounds of the server's clock: it answered each ping after that was sent, and before the answer was read. */

const MAX_PINGS = 20;

export class ServerClock {
  /** The server's time less this page's, at least and at most. @type {{ low_ms: number, high_ms: number }[]} */ bounds = [];
  low_ms = NaN; high_ms = NaN;

  /** Add a ping. @param {number} sent_ms @param {number} server_ms the server's answer @param {number} [now_ms] */
  addPing(sent_ms, server_ms, now_ms = performance.now()) {
    this.bounds.push({ low_ms: server_ms - now_ms, high_ms: server_ms - sent_ms });
    if (this.bounds.length > MAX_PINGS) this.bounds.shift();
    this.low_ms = Math.max(...this.bounds.map(({ low_ms }) => low_ms));
    this.high_ms = Math.min(...this.bounds.map(({ high_ms }) => high_ms));
  }

  /** Forget all pings: another server has another clock. */
  reset() { this.bounds = []; this.low_ms = this.high_ms = NaN; }

  /** Convert the server's time to this page's `performance.now()` [ms], at the earliest: an image never seems younger than it is.
   *  @param {number} server_ms */
  page_ms(server_ms) { return server_ms - this.high_ms; }

  /** Return the server's present at the earliest [ms], so that a message with this stamp never seems younger than it is; NaN
   *  before the first ping. @param {number} [now_ms] */
  stamp_ms(now_ms = performance.now()) { return now_ms + this.low_ms; }

  /** Estimate the server's present [ms]; NaN before the first ping. @param {number} [now_ms] */
  now_ms(now_ms = performance.now()) { return now_ms + (this.low_ms + this.high_ms) / 2; }
}
