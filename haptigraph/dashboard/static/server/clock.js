/** The server's clock as this page reads it: the exchange with the shortest way tells the offset best. */

const KEPT = 20;

export class ServerClock {
  constructor() { this.exchanges = []; this.offset_ms = NaN; }

  /** Take one exchange: when asked, what the server's clock said, now. */
  heard(asked_ms, server_ms, now_ms = performance.now()) {
    this.exchanges.push({ way_ms: now_ms - asked_ms, offset_ms: server_ms - (asked_ms + now_ms) / 2 });
    if (this.exchanges.length > KEPT) this.exchanges.shift();
    this.offset_ms = this.exchanges.reduce((a, b) => (b.way_ms < a.way_ms ? b : a)).offset_ms;
  }

  /** Forget everything: another server has another clock. */
  reset() { this.exchanges = []; this.offset_ms = NaN; }

  /** Turn the server's time into this page's `performance.now()` [ms]. */
  page_ms(server_ms) { return server_ms - this.offset_ms; }

  /** Return the server's present [ms]; NaN before the first exchange. */
  now_ms() { return performance.now() + this.offset_ms; }
}
