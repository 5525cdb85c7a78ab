/** Where relations hold, as outlines in the eye frame [mm]. Pure geometry, drawn by view.js. */

/**
 * Return the zone of a relation: closed outlines; null if its measure has no zone in the picture.
 *
 * @param {any} relation of the procedure's schema
 * @param {Record<string, any>} anatomy shapes by name
 */
export function zoneOf(relation, anatomy) {
  const object = anatomy[relation.object];
  const far = relation.at_most ?? relation.below;
  const near = relation.above ?? relation.at_least ?? 0;
  if (!object || far === null || far === undefined) return null;
  if (relation.measure === "theta_deg") return { kind: "cone", outline: cone(anatomy.trocar.at_mm, object.at_mm, far) };
  if (object.type === "polyline") return { kind: "zone", outline: band(object.points_mm, near, far) };
  if (object.type === "point" && relation.measure === "radial_mm") return { kind: "zone", outline: ring(object.at_mm, far) };
  return null;
}

/** The cone of half-angle `half_deg` from an apex, as far as the target. */
export function cone(apex, target, half_deg) {
  const x = target[0] - apex[0], y = target[1] - apex[1];
  const turned = (deg) => {
    const c = Math.cos(deg * Math.PI / 180), s = Math.sin(deg * Math.PI / 180);
    return [apex[0] + c * x - s * y, apex[1] + s * x + c * y];
  };
  return [apex, turned(-half_deg), turned(half_deg)];
}

/** What lies between two distances from a chain of points, on the side of the eye frame's origin. */
export function band(points, near, far) {
  return [...offset(points, near), ...offset(points, far).reverse()];
}

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

/** A circle as an outline. */
export function ring(center, radius) {
  return Array.from({ length: 48 }, (_, at) => {
    const angle = at / 24 * Math.PI;
    return [center[0] + radius * Math.cos(angle), center[1] + radius * Math.sin(angle)];
  });
}
