/** Draw again and again while the page is seen, but no more often than asked. */

const EARLY_MS = 4;  // a frame of the screen may come a little before its time

/**
 * @param {() => number} period_ms the least time between two drawings, asked each time
 * @param {() => void} draw
 */
export function every(period_ms, draw) {
  let drawn_ms = 0;
  const animate = (now_ms) => {
    requestAnimationFrame(animate);
    if (now_ms - drawn_ms < period_ms() - EARLY_MS) return;
    drawn_ms = now_ms;
    draw();
  };
  requestAnimationFrame(animate);
}
