/** Plane geometry: metres and radians, points as [x, y], polygons as lists of them. */

/** An angle in (-π, π]. */
export function wrap(angle) {
  return Math.atan2(Math.sin(angle), Math.cos(angle));
}

/** Body-frame points at a pose, in the world frame. */
export function placed(points, { x, y, theta }) {
  const c = Math.cos(theta),
    s = Math.sin(theta);
  return points.map(([px, py]) => [x + c * px - s * py, y + s * px + c * py]);
}

/** The corners of a footprint in the body frame; a circle as a fine polygon. */
export function outline(footprint) {
  if (footprint.type === "circle") return disc([0, 0], footprint.radius);
  if (footprint.type === "polygon") return footprint.vertices.filter(isPoint);
  const { length, width, offset = 0 } = footprint;
  return [
    [-1, -1],
    [1, -1],
    [1, 1],
    [-1, 1],
  ].map(([i, j]) => [offset + (i * length) / 2, (j * width) / 2]);
}

/** A disc as a polygon. */
export function disc([x, y], radius, corners = 48) {
  return Array.from({ length: corners }, (_, i) => {
    const angle = (2 * Math.PI * i) / corners;
    return [x + radius * Math.cos(angle), y + radius * Math.sin(angle)];
  });
}

/** An obstacle as a polygon. */
export function corners(obstacle) {
  return obstacle.type === "circle"
    ? disc(obstacle.center, obstacle.radius)
    : obstacle.vertices.filter(isPoint);
}

export function isPoint(point) {
  return Array.isArray(point) && point.length >= 2 && point.every(Number.isFinite);
}

/** The mean of an obstacle's corners, or a circle's centre. */
export function middle(obstacle) {
  if (obstacle.type === "circle") return obstacle.center;
  const n = obstacle.vertices.length;
  return [0, 1].map((axis) => obstacle.vertices.reduce((sum, v) => sum + v[axis], 0) / n);
}

/** [x_min, y_min, x_max, y_max] of points. */
export function extent(points) {
  const xs = points.map((p) => p[0]),
    ys = points.map((p) => p[1]);
  return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
}

/** The farthest a body-frame outline reaches from the body origin. */
export function reach(points) {
  return points.reduce((most, [x, y]) => Math.max(most, Math.hypot(x, y)), 0);
}

/** Whether a point lies in a polygon (even-odd rule). */
export function inside([x, y], polygon) {
  let odd = false;
  for (let i = 0, j = polygon.length - 1; i < polygon.length; j = i++) {
    const [xi, yi] = polygon[i],
      [xj, yj] = polygon[j];
    if (yi > y !== yj > y && x < ((xj - xi) * (y - yi)) / (yj - yi) + xi) odd = !odd;
  }
  return odd;
}

/** How far apart two polygons are; minus the deepest that a corner of one lies in the other, where they overlap. */
export function separation(a, b) {
  let apart = Infinity,
    deep = 0;
  for (const [from, to] of [
    [a, b],
    [b, a],
  ]) {
    for (const corner of from) {
      const distance = edgeDistance(corner, to);
      apart = Math.min(apart, distance);
      if (inside(corner, to)) deep = Math.max(deep, distance);
    }
  }
  return deep > 0 ? -deep : crossing(a, b) ? -Number.EPSILON : apart;
}

function edgeDistance([x, y], polygon) {
  return polygon.reduce((least, [ax, ay], i) => {
    const [bx, by] = polygon[(i + 1) % polygon.length];
    const dx = bx - ax,
      dy = by - ay;
    const along = Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1)));
    return Math.min(least, Math.hypot(x - ax - along * dx, y - ay - along * dy));
  }, Infinity);
}

function crossing(a, b) {
  const side = ([ax, ay], [bx, by], [px, py]) => Math.sign((bx - ax) * (py - ay) - (by - ay) * (px - ax));
  return a.some((p, i) => {
    const q = a[(i + 1) % a.length];
    return b.some((r, j) => {
      const s = b[(j + 1) % b.length];
      return side(p, q, r) !== side(p, q, s) && side(r, s, p) !== side(r, s, q);
    });
  });
}
