/** Draw repeatedly while the page is visible, at a limited rate. */

const TOLERANCE_MS = 4;  // an animation frame may come a little early

/**
 * Ask for an animation frame only when a drawing is due: the browser composes the whole page in every frame asked for.
 *
 * @param {() => number} period_ms minimum time between two drawings @param {() => void} draw
 */
export function animate(period_ms, draw) {
  const next = () => {
    setTimeout(() => requestAnimationFrame(next), period_ms() - TOLERANCE_MS);
    draw();
  };
  requestAnimationFrame(next);
}
