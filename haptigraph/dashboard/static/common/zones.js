/** The regions in which relations hold, as outlines in the eye frame [mm]; drawn by view.js. */

/** Return the region of a relation; null if its measure has none in the image plane.
 *  @param {Relation} relation @param {Record<string, Shape>} anatomy shapes by name
 *  @returns {{ kind: "cone" | "zone", outline: Vec[] } | null} */
export function zoneOf(relation, anatomy) {
  const object = anatomy[relation.object], { trocar } = anatomy;
  const far = relation.at_most ?? relation.below;
  const near = relation.above ?? relation.at_least ?? 0;
  if (!object || far === null) return null;
  if (relation.measure === "theta_deg" && trocar?.type === "point" && object.type === "point") return { kind: "cone", outline: cone(trocar.at_mm, object.at_mm, far) };
  if (object.type === "polyline") return { kind: "zone", outline: band(object.points_mm, near, far) };
  if (object.type === "point" && relation.measure === "radial_mm") return { kind: "zone", outline: circle(object.at_mm, far) };
  return null;
}

/** Return a cone from an apex to the target. @param {Vec} apex @param {Vec} target @param {number} half_deg @returns {Vec[]} */
function cone(apex, target, half_deg) {
  const x = target[0] - apex[0], y = target[1] - apex[1];
  /** @returns {Vec} */ const turned = (/** @type {number} */ deg) => {
    const c = Math.cos(deg * Math.PI / 180), s = Math.sin(deg * Math.PI / 180);
    return [apex[0] + c * x - s * y, apex[1] + s * x + c * y];
  };
  return [apex, turned(-half_deg), turned(half_deg)];
}

/** Return the band between two distances from a polyline, towards the origin. @param {Vec[]} points @param {number} near @param {number} far */
function band(points, near, far) { return [...offset(points, near), ...offset(points, far).reverse()]; }

/** @param {Vec[]} points @param {number} distance @returns {Vec[]} */
function offset(points, distance) {
  return points.map((point, at) => {
    const before = points[Math.max(at - 1, 0)], after = points[Math.min(at + 1, points.length - 1)];
    let x = -(after[1] - before[1]), y = after[0] - before[0];
    const length = Math.hypot(x, y) || 1;
    const inwards = x * -point[0] + y * -point[1] >= 0 ? 1 : -1;
    x *= inwards / length; y *= inwards / length;
    return [point[0] + distance * x, point[1] + distance * y];
  });
}

/** Return a circle as an outline. @param {Vec} center @param {number} radius @returns {Vec[]} */
export function circle(center, radius) {
  return Array.from({ length: 48 }, (_, at) => {
    const angle = at / 24 * Math.PI;
    return [center[0] + radius * Math.cos(angle), center[1] + radius * Math.sin(angle)];
  });
}
