/** Estimate of the server's clock, from the ping with the shortest round trip. */

const MAX_PINGS = 20;

export class ServerClock {
  /** @type {{ roundTrip_ms: number, offset_ms: number }[]} */ pings = [];
  offset_ms = NaN;

  /** Add a ping. @param {number} sent_ms @param {number} server_ms the server's answer @param {number} [now_ms] */
  addPing(sent_ms, server_ms, now_ms = performance.now()) {
    this.pings.push({ roundTrip_ms: now_ms - sent_ms, offset_ms: server_ms - (sent_ms + now_ms) / 2 });
    if (this.pings.length > MAX_PINGS) this.pings.shift();
    this.offset_ms = this.pings.reduce((a, b) => (b.roundTrip_ms < a.roundTrip_ms ? b : a)).offset_ms;
  }

  /** Forget all pings: another server has another clock. */
  reset() { this.pings = []; this.offset_ms = NaN; }

  /** Convert the server's time to this page's `performance.now()` [ms]. @param {number} server_ms */
  page_ms(server_ms) { return server_ms - this.offset_ms; }

  /** Return the server's present [ms]; NaN before the first ping. */
  now_ms() { return performance.now() + this.offset_ms; }
}
