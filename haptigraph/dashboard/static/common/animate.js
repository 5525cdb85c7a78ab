/** Draw repeatedly while the page is visible, at a limited rate. */

const TOLERANCE_MS = 4;  // an animation frame may come a little early

/** @param {() => number} period_ms minimum time between two drawings @param {() => void} draw */
export function animate(period_ms, draw) {
  let drawn_ms = 0;
  const next = (/** @type {number} */ now_ms) => {
    requestAnimationFrame(next);
    if (now_ms - drawn_ms < period_ms() - TOLERANCE_MS) return;
    drawn_ms = now_ms;
    draw();
  };
  requestAnimationFrame(next);
}
