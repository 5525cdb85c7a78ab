/** Strips: one curve over time each, with the bounds that the procedure decides by. */

import { colors } from "../theme/colors.js";

/** Choose what to plot: two depths in µm, or else the first distance and angle with bounds, or else the first measures.
 *  @param {Relation[]} relations */
export function stripsOf(relations) {
  const measures = [...new Set(relations.map((relation) => relation.measure_name))];
  const depths = measures.filter((name) => name.endsWith("_um")).slice(0, 2);
  const wanted = depths.length ? depths : ["mm", "deg"].flatMap((unit) => measures.find((name) => name.endsWith(`_${unit}`)) ?? []);
  return (wanted.length ? wanted : measures.slice(0, 2)).map((measure) => stripOf(measure, relations));
}

/** Return the bounds that relations set on a measure. @param {string} measure @param {Relation[]} relations @returns {Bounds} */
export function boundsOf(measure, relations) {
  const own = relations.filter((relation) => relation.measure_name === measure);
  const bounds = [...new Set(own.flatMap((r) => [r.at_most, r.below, r.at_least, r.above]).filter((bound) => bound !== null))];
  return { bounds, band: measure.endsWith("_deg") && own.length ? Math.min(...own.map((r) => r.at_most ?? Infinity)) : 0 };
}

/** @param {string} measure @param {Relation[]} relations @returns {Strip} */
function stripOf(measure, relations) {
  const { bounds, band } = boundsOf(measure, relations);
  const unit = measure.split("_").at(-1) ?? "", largest = Math.max(...bounds, 1e-6);
  const isAngle = unit === "deg", isDepth = unit === "um";
  return {
    measure, bounds, band, unit: isAngle ? "°" : isDepth ? "µm" : unit, digits: isDepth ? 0 : isAngle ? 1 : 2,
    label: measure.replace(/_(mm|um|deg)$/, "").replace("distance_to_", "to ").replaceAll("_", " "),
    min: isAngle ? 0 : isDepth ? -0.5 * largest : -1, max: largest * (isAngle || (isDepth && bounds.length === 1) ? 5 : 2),
  };
}

/** Draw a strip's band of tolerated values and its bounds; return its scale, from values to canvas y.
 *  @param {CanvasRenderingContext2D} c @param {Strip} strip
 *  @param {{ left: number, width: number, top: number, height: number }} box
 *  @param {(text: string, y: number) => void} drawLabel called for the bounds that have room for a label */
export function drawBounds(c, strip, { left, width, top, height }, drawLabel) {
  const y = (/** @type {number} */ value) => top + height * (1 - Math.min(Math.max((value - strip.min) / (strip.max - strip.min), 0), 1));
  c.fillStyle = colors.good; c.globalAlpha = 0.15;
  if (strip.band) c.fillRect(left, y(strip.band), width, y(0) - y(strip.band));
  c.globalAlpha = 1;
  c.lineWidth = 1; c.strokeStyle = colors.line; c.fillStyle = colors.quiet;
  for (const [at, bound] of strip.bounds.entries()) {
    c.beginPath(); c.moveTo(left, y(bound)); c.lineTo(left + width, y(bound)); c.stroke();
    if (!strip.bounds.slice(0, at).some((other) => Math.abs(y(other) - y(bound)) < 11)) drawLabel(String(bound), y(bound));
  }
  return y;
}
