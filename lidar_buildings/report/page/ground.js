// The terrain: its mesh, its colours by the classes of the points on it, and how much of the sky it sees.

/** Cells of the field along its longer side at most, and their size at least [m]. */
const MOST_FIELD_CELLS = 512, LEAST_CELL = 0.5;
/** Tints of the ground by class of point. */
const TINTS = { 2: "#d3cab4", 3: "#bcc99c", 4: "#a9be8b", 5: "#98b47e", 9: "#86b4dc", 10: "#aaa3a0", 11: "#bfbfc1", 17: "#cfc9bf" };
const BARE = [214, 206, 188];
/** Steps from a cell in which the horizon is looked for [cells]. */
const HORIZON = [1, 2, 3, 5, 8, 13, 21];

/** Return a raster's elevation at a place [m], between the middles of cells; null where it is unknown. */
function elevationAt(relief, facts, x, y) {
  if (!relief) return null;
  const [rows, columns] = relief.shape, across = (x - facts.west) / facts.cell[0] - 0.5, down = (facts.north - y) / facts.cell[1] - 0.5;
  if (across < -0.5 || down < -0.5 || across >= columns - 0.5 || down >= rows - 0.5) return null;
  const column = clamped(Math.floor(across), 0, Math.max(columns - 2, 0)), row = clamped(Math.floor(down), 0, Math.max(rows - 2, 0));
  const [a, b] = [clamped(across - column, 0, 1), clamped(down - row, 0, 1)];
  let sum = 0, weights = 0;
  for (const [r, c, weight] of [[row, column, (1 - a) * (1 - b)], [row, column + 1, a * (1 - b)], [row + 1, column, (1 - a) * b], [row + 1, column + 1, a * b]]) {
    const steps = relief.array[Math.min(r, rows - 1) * columns + Math.min(c, columns - 1)];
    if (steps === facts.unknown || !weight) continue;
    sum += weight * steps;
    weights += weight;
  }
  return weights > 0.25 ? facts.middle + (sum / weights) * facts.step : null;
}

/** A raster over the scene, relative to its centre: ground and solid elevations, colours, openness to the sky. */
class Field {
  constructor(scene) {
    const [low, high] = scene.bounds.map((place) => scene.near(place)), wide = high[0] - low[0], deep = high[1] - low[1];
    this.cell = Math.max(Math.max(wide, deep) / MOST_FIELD_CELLS, LEAST_CELL);
    [this.west, this.north] = [low[0], high[1]];
    [this.columns, this.rows] = [wide, deep].map((size) => Math.max(Math.ceil(size / this.cell), 2));
    this.ground = new Float32Array(this.columns * this.rows).fill(low[2]);
    this.eachCell((at, x, y) => {
      const known = elevationAt(scene.data.terrain, scene.facts.terrain, x + scene.centre[0], y + scene.centre[1]);
      if (known != null) this.ground[at] = known - scene.centre[2];
    });
    this.solid = this.ground.slice();
    this.raise(scene);
    this.cover = new Uint8Array(4 * this.columns * this.rows);
    this.paint(scene);
    this.open();
  }

  eachCell(act) {
    for (let r = 0, at = 0; r < this.rows; r++)
      for (let c = 0; c < this.columns; c++, at++) act(at, this.west + (c + 0.5) * this.cell, this.north - (r + 0.5) * this.cell, r, c);
  }

  /** Return the cell of a place, -1 beside the field. */
  cellAt(x, y) {
    const c = Math.floor((x - this.west) / this.cell), r = Math.floor((this.north - y) / this.cell);
    return c < 0 || r < 0 || c >= this.columns || r >= this.rows ? -1 : r * this.columns + c;
  }

  solidAt(x, y) {
    const at = this.cellAt(x, y);
    return at < 0 ? null : this.solid[at];
  }

  groundAt(x, y) {
    const at = this.cellAt(x, y);
    return this.ground[Math.max(at, 0)];
  }

  /** Lift the solid elevations to the roofs. */
  raise(scene) {
    for (const solid of scene.solids().filter((one) => one.level === scene.levels[0]))
      for (let t = solid.first; t < solid.first + solid.count; t++) {
        if (scene.data.kinds.array[t] !== KIND.roof) continue;
        const [p, q, s] = [0, 1, 2].map((k) => scene.near(scene.corner(t, k)));
        const twice = (q[0] - p[0]) * (s[1] - p[1]) - (q[1] - p[1]) * (s[0] - p[0]);
        if (twice < 1e-9) continue;
        const range = (axis, from, sign) => [p, q, s].map((one) => (sign * (one[axis] - from)) / this.cell);
        const [cs, rs] = [range(0, this.west, 1), range(1, this.north, -1)];
        for (let r = Math.max(Math.floor(Math.min(...rs)), 0); r <= Math.min(Math.max(...rs), this.rows - 1); r++)
          for (let c = Math.max(Math.floor(Math.min(...cs)), 0); c <= Math.min(Math.max(...cs), this.columns - 1); c++) {
            const x = this.west + (c + 0.5) * this.cell, y = this.north - (r + 0.5) * this.cell;
            const b = ((x - p[0]) * (s[1] - p[1]) - (y - p[1]) * (s[0] - p[0])) / twice, d = ((q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])) / twice;
            if (b < 0 || d < 0 || b + d > 1) continue;
            const at = r * this.columns + c, z = p[2] + b * (q[2] - p[2]) + d * (s[2] - p[2]);
            if (z > this.solid[at]) this.solid[at] = z;
          }
      }
  }

  /** Colour the ground by the classes or own colours of its points, blurred over gaps, with the relief's shade. */
  paint(scene) {
    const { array } = scene.data.classes, own = scene.data.colours?.array, sums = new Float32Array(4 * this.columns * this.rows);
    for (let i = 0; i < array.length; i++) {
      const kind = array[i] & ~FACADE, tint = TINTS[kind];
      if (!tint || (own && (kind === 4 || kind === 5))) continue;
      const [x, y] = scene.near(scene.point(i)), at = this.cellAt(x, y);
      if (at < 0) continue;
      const colour = own ? [own[3 * i], own[3 * i + 1], own[3 * i + 2]] : [1, 3, 5].map((k) => parseInt(tint.slice(k, k + 2), 16));
      colour.forEach((value, k) => (sums[4 * at + k] += value));
      sums[4 * at + 3] += 1;
    }
    const reach = Math.max(Math.round(1.5 / this.cell), 1);
    for (let round = 0; round < 2; round++) this.blur(sums, 4, reach);
    const slope = (at, step, is) => (is ? (this.ground[at + step] - this.ground[at - step]) / (2 * this.cell) : 0);
    this.eachCell((at, x, y, r, c) => {
      const east = slope(at, 1, c > 0 && c < this.columns - 1), north = -slope(at, this.columns, r > 0 && r < this.rows - 1);
      const shade = clamped(1 + 0.9 * (dot(normalised([-1.6 * east, -1.6 * north, 1]), SUN) - SUN[2]), 0.6, 1.25), weight = sums[4 * at + 3] + 0.02;
      for (let k = 0; k < 3; k++) this.cover[4 * at + k] = clamped(((sums[4 * at + k] + 0.02 * BARE[k]) / weight) * shade, 0, 255);
    });
  }

  /** Average values of so many channels over squares, along rows and then along columns. */
  blur(values, channels, reach) {
    const line = new Float32Array(Math.max(this.columns, this.rows)), down = channels * this.columns;
    for (const [n, length, step, next] of [[this.rows, this.columns, channels, down], [this.columns, this.rows, down, channels]])
      for (let one = 0; one < n; one++)
        for (let start = one * next; start < one * next + channels; start++) {
          let sum = 0;
          for (let i = 0; i < length + reach; i++) {
            if (i < length) sum += line[i] = values[start + i * step];
            if (i > 2 * reach) sum -= line[i - 2 * reach - 1];
            if (i >= reach) values[start + (i - reach) * step] = sum / (Math.min(i, length - 1) - Math.max(i - 2 * reach, 0) + 1);
          }
        }
  }

  /** Write how much of the sky each cell sees, by its horizon in eight directions. */
  open() {
    const open = new Float32Array(this.solid.length), around = [[0, 1], [1, 1], [1, 0], [1, -1], [0, -1], [-1, -1], [-1, 0], [-1, 1]];
    this.eachCell((at, x, y, r, c) => {
      let seen = 0;
      for (const [down, across] of around) {
        const unit = Math.hypot(down, across) * this.cell;
        let steepest = 0;
        for (const n of HORIZON) {
          const [row, column] = [r + n * down, c + n * across];
          if (row < 0 || column < 0 || row >= this.rows || column >= this.columns) break;
          steepest = Math.max(steepest, (this.solid[row * this.columns + column] - this.solid[at]) / (n * unit));
        }
        seen += 1 / (1 + steepest * steepest);
      }
      open[at] = 0.2 + 0.8 * (seen / 8);
    });
    this.blur(open, 1, 1);
    open.forEach((value, at) => (this.cover[4 * at + 3] = 255 * value));
  }
}

/** The terrain's mesh of so many fields along its longer side, with walls down to a base where it ends. */
function terrainVertices(scene, fields) {
  const relief = scene.data.terrain, facts = scene.facts.terrain;
  if (!relief) return new Vertices(0);
  const step = Math.max(1, Math.round(Math.max(...relief.shape) / fields)), [height, width] = relief.shape;
  const [rows, columns] = relief.shape.map((size) => Math.ceil((size - 1) / step) + 1);
  const deep = clamped(0.01 * Math.hypot(...minus(scene.bounds[1], scene.bounds[0])), 0.5, 5), base = scene.near(scene.bounds[0])[2] - deep;
  const cells = [], colour = 0xffffffff, side = rgb("#c9c2b4"), borders = new Map();
  const stepsAt = (at) => relief.array[Math.min(Math.floor(at / columns) * step, height - 1) * width + Math.min((at % columns) * step, width - 1)];
  const place = (at) => {
    const [row, column] = [Math.min(Math.floor(at / columns) * step, height - 1), Math.min((at % columns) * step, width - 1)];
    return scene.near([facts.west + (column + 0.5) * facts.cell[0], facts.north - (row + 0.5) * facts.cell[1], facts.middle + stepsAt(at) * facts.step]);
  };
  const border = (a, b) => (borders.delete(`${b} ${a}`) ? null : borders.set(`${a} ${b}`, [a, b]));
  for (let r = 0; r + 1 < rows; r++)
    for (let c = 0; c + 1 < columns; c++) {
      const a = r * columns + c, [b, d, e] = [a + 1, a + columns, a + columns + 1];
      if ([a, b, d, e].some((at) => stepsAt(at) === facts.unknown)) continue;
      cells.push(a, d, b, b, d, e);
      border(a, d), border(d, e), border(e, b), border(b, a);
    }
  const vertices = new Vertices(rows * columns + 4 * borders.size);
  for (let at = 0; at < rows * columns; at++) vertices.set(at, ...place(at), colour);
  let next = rows * columns;
  for (const ends of borders.values()) {
    for (const at of ends) {
      const [x, y, z] = place(at);
      vertices.set(next++, x, y, z, side);
      vertices.set(next++, x, y, base, side);
    }
    cells.push(next - 4, next - 3, next - 2, next - 2, next - 3, next - 1);
  }
  vertices.rows = new Uint32Array(cells);
  return vertices;
}
