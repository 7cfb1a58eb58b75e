// Distances of points to the roof under or over them, and what they are per face.

/** Roof triangles of a building at a level: plan bounds, and z = a x + b y + c. */
function roofTriangles(scene, row, level) {
  const found = [], { kinds, faces } = scene.data;
  for (const solid of scene.solids().filter((one) => one.row === row && one.level === level))
    for (let t = solid.first; t < solid.first + solid.count; t++) {
      if (kinds.array[t] !== KIND.roof) continue;
      const corners = [0, 1, 2].map((k) => scene.corner(t, k)), [x, y, z] = scene.normal(t);
      if (z < 1e-6) continue;
      const [a, b] = [-x / z, -y / z], c = corners[0][2] - a * corners[0][0] - b * corners[0][1];
      const xs = corners.map((one) => one[0]), ys = corners.map((one) => one[1]);
      const area = 0.5 * ((xs[1] - xs[0]) * (ys[2] - ys[0]) - (xs[2] - xs[0]) * (ys[1] - ys[0])) / z;
      const box = [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
      found.push({ face: faces.array[t], corners, box, a, b, c, z, area });
    }
  return found;
}

function holds({ corners: [p, q, r], box }, x, y) {
  if (x < box[0] || y < box[1] || x > box[2] || y > box[3]) return false;
  const side = (a, b) => (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]);
  return side(p, q) >= 0 && side(q, r) >= 0 && side(r, p) >= 0;
}

/** Walls of a building at a level: ends in plan, and between which elevations they stand. */
function walls(scene, row, level) {
  const found = [], { kinds } = scene.data;
  for (const solid of scene.solids().filter((one) => one.row === row && one.level === level))
    for (let t = solid.first; t < solid.first + solid.count; t++) {
      if (kinds.array[t] !== KIND.wall) continue;
      const corners = [0, 1, 2].map((k) => scene.corner(t, k)), heights = corners.map((one) => one[2]);
      const far = (k) => Math.hypot(corners[k][0] - corners[(k + 1) % 3][0], corners[k][1] - corners[(k + 1) % 3][1]);
      const k = [0, 1, 2].reduce((best, one) => (far(one) > far(best) ? one : best), 0);
      found.push([corners[k], corners[(k + 1) % 3], Math.min(...heights), Math.max(...heights)]);
    }
  return found;
}

/** Distance to the nearest wall that stands at a point's elevation [m]. */
function wallDistance(all, [x, y, z]) {
  let least = Infinity;
  for (const [[ax, ay], [bx, by], low, high] of all) {
    if (z < low - FAR || z > high + FAR) continue;
    const [dx, dy] = [bx - ax, by - ay], share = Math.min(Math.max(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1), 0), 1);
    least = Math.min(least, Math.hypot(x - ax - share * dx, y - ay - share * dy));
  }
  return least;
}

/**
 * Fill in the distances of a building's roof points to its model [m], positive above it; NaN beside it and of walls.
 * Points that are far from their roof may be nearer to a wall. Return per face its number, slope, area, points and rmse.
 */
function measureBuilding(scene, row, level, residuals) {
  const triangles = roofTriangles(scene, row, level), upright = walls(scene, row, level), faces = new Map();
  for (const one of triangles) {
    const face = faces.get(one.face) ?? { number: one.face, plan: 0, area: 0, n: 0, sum: 0 };
    face.area += one.area;
    face.plan += one.area * one.z;
    faces.set(one.face, face);
  }
  const [first, last] = scene.ranges.get(row + 1) ?? [0, 0];
  for (let i = first; i < last; i++) {
    residuals[i] = NaN;
    if (scene.data.classes.array[i] & FACADE) continue;
    const [x, y, z] = scene.point(i), under = triangles.find((one) => holds(one, x, y));
    if (!under) continue;
    let far = (z - under.a * x - under.b * y - under.c) * under.z;
    if (Math.abs(far) > 0.05) far = Math.sign(far) * Math.min(Math.abs(far), wallDistance(upright, [x, y, z]));
    residuals[i] = far;
    const face = faces.get(under.face);
    face.n += 1;
    face.sum += far ** 2;
  }
  const slope = (one) => Math.acos(Math.min(one.plan / one.area, 1)) * 180 / Math.PI;
  const found = [...faces.values()].map((one) => ({ ...one, slope: slope(one), rmse: one.n ? Math.sqrt(one.sum / one.n) : null }));
  return { faces: found.sort((a, b) => b.area - a.area), n: last - first };
}
