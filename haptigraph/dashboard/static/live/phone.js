/** The phone's own motor, in the shape of a controller, so that the rules of `Rumble` hold for it too.
 *
 * It is on or off: for a share of each cycle that grows with the level. What it plays ends by itself.
 */

const CYCLE_MS = 60, SHORTEST_MS = 20;

const actuator = {
  /** @param {string} _kind @param {{ duration: number, strongMagnitude: number }} effect */
  playEffect(_kind, { duration, strongMagnitude }) { navigator.vibrate(pulses(strongMagnitude, duration)); return Promise.resolve("complete"); },
  reset() { navigator.vibrate(0); return Promise.resolve("complete"); },
};

/** The motor, or null where the browser has none for pages. */
export const phone = "vibrate" in navigator && matchMedia("(any-pointer: coarse)").matches
  ? /** @type {Pick<Gamepad, "vibrationActuator">} */ (/** @type {unknown} */ ({ vibrationActuator: actuator })) : null;

/** Return on and off times [ms] that end after a duration. @param {number} share @param {number} duration_ms */
function pulses(share, duration_ms) {
  const on_ms = Math.round(Math.min(Math.max(share * CYCLE_MS, SHORTEST_MS), CYCLE_MS));
  if (on_ms === CYCLE_MS) return [duration_ms];
  const times = [];
  for (let left_ms = duration_ms; left_ms > 0; left_ms -= CYCLE_MS) times.push(Math.min(on_ms, left_ms), CYCLE_MS - on_ms);
  return times.slice(0, -1);  // an off time at the end means nothing
}
