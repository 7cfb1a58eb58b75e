// What is drawn: models, points and rings as vertices, coloured as chosen.

const KIND = { ground: 0, wall: 1, roof: 2 };
const OUTLINE = 0, FACADE = 128;
const rgb = (text) => {
  const value = parseInt(text.slice(1), 16);
  return (255 << 24 | (value & 255) << 16 | value & 0xff00 | value >> 16) >>> 0;
};
const css = (word) => `rgb(${word & 255},${(word >> 8) & 255},${(word >> 16) & 255})`;
/** Colour at a place from 0 to 1 of a ramp of colours. */
const ramp = (colours) => {
  const stops = colours.map((text) => parseInt(text.slice(1), 16));
  return (share) => {
    const place = Math.min(Math.max(share, 0), 1) * (stops.length - 1), k = Math.min(Math.floor(place), stops.length - 2);
    const mixed = [16, 8, 0].map((bits) => {
      const [a, b] = [(stops[k] >> bits) & 255, (stops[k + 1] >> bits) & 255];
      return Math.round(a + (b - a) * (place - k));
    });
    return (255 << 24 | mixed[2] << 16 | mixed[1] << 8 | mixed[0]) >>> 0;
  };
};
const SLOPES = ramp(["#d6d0c3", "#e2b68d", "#d07f58", "#a94c3c", "#6b2b33"]);
const HEIGHTS = ramp(["#2a1a5e", "#3355c4", "#22a6c9", "#6fe0a5", "#f2fff0"]);
const GOODNESS = ramp(["#2f9e63", "#e3d25a", "#d9432f"]);
const SIGNED = ramp(["#2459a8", "#8fb7dd", "#f5f2ea", "#eba17c", "#b3261e"]);
const STATUSES = { good: "#2f9e63", check: "#e0a526", poor: "#c2262e", ok: "#2f9e63", traced_outline: "#e0a526", cut_off: "#8a63c0", degenerate: "#7d8790", no_solid: "#e0662f", failed: "#c2262e", unknown: "#5c88b0" };
/** How good a building is: its quality, or its status where the run ended before there were models. */
const standing = (known) => known.quality || known.status || "unknown";
const standingColour = (known) => STATUSES[standing(known)] ?? STATUSES.unknown;
const CLASSES = { 0: "#b9b9b9", 1: "#b9b9b9", 2: "#a98a64", 3: "#a8cf7a", 4: "#74b35a", 5: "#3f8a43", 6: "#00b4e6", 9: "#3d85c6", 10: "#7a6a8a", 11: "#8d8f94", 17: "#c79a3e" };
const PALETTE = ["#4e79a7", "#f28e2b", "#59a14f", "#b07aa1", "#76b7b2", "#edc948", "#e15759", "#9c755f", "#ff9da7", "#86bcb6", "#d4a6c8", "#8cd17d"];
const WALL = rgb("#efeae0"), FOOT = rgb("#a7a79c"), EDGE = rgb("#262b31"), NONE = rgb("#c3c8cd");
/** So far above the ground walls are in the open [m]. */
const OPEN_ABOVE = 14;
/** Distances of points to the model are coloured up to this one [m]. */
const FAR = 0.3;

class Scene {
  constructor(data) {
    this.data = data;
    this.facts = data.facts;
    /** Rows of buildings that a filter leaves out. */
    this.dimmed = new Set();
    this.types = [...new Set(this.facts.attributes.map((one) => one.roof_type ?? "unknown"))].sort();
    this.bounds = this.measured();
    this.centre = [0, 1].map((axis) => (this.bounds[0][axis] + this.bounds[1][axis]) / 2).concat(this.bounds[0][2]);
    this.levels = [...new Set(this.solids().map((one) => one.level))].sort((a, b) => b - a);
    this.ranges = this.pointRanges();
    this.classColours = Array.from({ length: 256 }, (_, one) => rgb(CLASSES[one & ~FACADE] ?? "#b9b9b9"));
  }

  solids() {
    const array = this.data.solids.array;
    return (this.known ??= Array.from({ length: array.length / 4 }, (_, k) => ({ row: array[4 * k], level: array[4 * k + 1], first: array[4 * k + 2], count: array[4 * k + 3] })));
  }

  /** Lowest and highest coordinates of all that is shown, map frame [m]. */
  measured() {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    const see = (axis, value) => {
      low[axis] = Math.min(low[axis], value);
      high[axis] = Math.max(high[axis], value);
    };
    const { array } = this.data.vertices, { corner, step } = this.facts.points, points = this.data.points.array;
    for (let i = 0; i < array.length; i++) see(i % 3, array[i] / 1000);
    for (let i = 0; i < points.length; i++) see(i % 3, corner[i % 3] + step[i % 3] * points[i]);
    const rings = this.data.ring_vertices.array;
    for (let i = 0; i < rings.length; i++) see(i % 2, rings[i] / 1000);
    return [0, 1, 2].every((axis) => low[axis] <= high[axis]) ? [low, high] : [[0, 0, 0], [1, 1, 1]];
  }

  /** First and last point of each building's row; points are sorted by it. */
  pointRanges() {
    const building = this.data.building.array, first = new Map();
    for (let i = 0; i < building.length; i++) {
      const range = first.get(building[i]);
      if (range) range[1] = i + 1;
      else first.set(building[i], [i, i + 1]);
    }
    return first;
  }

  point(row) {
    const { corner, step } = this.facts.points, points = this.data.points.array;
    return [0, 1, 2].map((axis) => corner[axis] + step[axis] * points[3 * row + axis]);
  }

  /** Return a model's corner [m]. */
  corner(triangle, k) {
    const row = this.data.triangles.array[3 * triangle + k] * 3, vertices = this.data.vertices.array;
    return [vertices[row] / 1000, vertices[row + 1] / 1000, vertices[row + 2] / 1000];
  }

  normal(triangle) {
    const [a, b, c] = [0, 1, 2].map((k) => this.corner(triangle, k));
    return normalised(cross(b.map((v, i) => v - a[i]), c.map((v, i) => v - a[i])));
  }

  /** Surfaces of a level; walls know how far above the field's ground they are. */
  modelVertices(level, mode, field) {
    const solids = this.solids().filter((one) => one.level === level), kinds = this.data.kinds.array;
    const vertices = new Vertices(3 * solids.reduce((sum, one) => sum + one.count, 0));
    let row = 0;
    for (const solid of solids)
      for (let t = solid.first; t < solid.first + solid.count; t++) {
        const colour = kinds[t] === KIND.roof ? this.roofColour(solid.row, t, mode) : kinds[t] === KIND.wall ? WALL : FOOT;
        const normal = this.normal(t);
        for (let k = 0; k < 3; k++) {
          const [x, y, z] = this.near(this.corner(t, k)), risen = normal[2] < 0.5 ? clamped((z - field.groundAt(x, y)) / OPEN_ABOVE, 0, 1) : 0;
          vertices.set(row++, x, y, z, colour, solid.row + 1, Vertices.packed(normal, risen));
        }
      }
    return vertices;
  }

  near(place) {
    return [place[0] - this.centre[0], place[1] - this.centre[1], place[2] - this.centre[2]];
  }

  roofColour(row, triangle, mode) {
    const known = this.facts.attributes[row];
    if (this.dimmed.has(row)) return WALL;
    if (mode === "quality") return rgb(standingColour(known));
    if (mode === "type") return rgb(PALETTE[this.types.indexOf(known.roof_type ?? "unknown") % PALETTE.length]);
    if (mode === "rmse") return known.rmse == null ? NONE : GOODNESS((known.rmse * this.facts.unit) / FAR);
    const [x, y, z] = this.normal(triangle), slope = Math.atan2(Math.hypot(x, y), z) * 180 / Math.PI;
    if (mode === "slope") return SLOPES(slope / 60);
    return slope < 3 ? NONE : rgb(PALETTE[Math.round(((Math.atan2(x, y) / Math.PI + 2) % 2) * 4) % 8]);
  }

  /** Edges between different faces of a level's solids. */
  edgeVertices(level) {
    const faces = this.data.faces.array, rows = this.data.triangles.array, ends = [];
    for (const solid of this.solids().filter((one) => one.level === level)) {
      const seen = new Map();
      for (let t = solid.first; t < solid.first + solid.count; t++)
        for (let k = 0; k < 3; k++) {
          const a = rows[3 * t + k], b = rows[3 * t + (k + 1) % 3], key = a < b ? a * 2 ** 26 + b : b * 2 ** 26 + a;
          if (!seen.has(key)) seen.set(key, [t, k, faces[t], false]);
          else if (seen.get(key)[2] !== faces[t]) seen.get(key)[3] = true;
        }
      for (const [t, k, , isEdge] of seen.values()) if (isEdge) ends.push([t, k]);
    }
    const vertices = new Vertices(2 * ends.length);
    ends.forEach(([t, k], i) => {
      vertices.set(2 * i, ...this.near(this.corner(t, k)), EDGE);
      vertices.set(2 * i + 1, ...this.near(this.corner(t, (k + 1) % 3)), EDGE);
    });
    return vertices;
  }

  pointVertices(mode, residuals, [first, last] = [0, this.data.classes.array.length]) {
    const { corner, step } = this.facts.points, places = this.data.points.array, building = this.data.building.array;
    const vertices = new Vertices(last - first), [x, y, z] = corner.map((value, axis) => value - this.centre[axis]);
    for (let i = first; i < last; i++) {
      const colour = this.pointColour(i, mode, residuals);
      vertices.set(i - first, x + step[0] * places[3 * i], y + step[1] * places[3 * i + 1], z + step[2] * places[3 * i + 2], colour, building[i]);
    }
    return vertices;
  }

  pointColour(i, mode, residuals) {
    const { classes, building, plane, colours } = this.data;
    if (mode === "class") return this.classColours[classes.array[i]];
    if (mode === "height") return HEIGHTS((this.point(i)[2] - this.bounds[0][2]) / (this.bounds[1][2] - this.bounds[0][2] || 1));
    if (mode === "colour") return (0xff000000 | (colours.array[3 * i + 2] << 16) | (colours.array[3 * i + 1] << 8) | colours.array[3 * i]) >>> 0;
    if (!building.array[i]) return NONE;
    if (mode === "building") return rgb(PALETTE[(building.array[i] * 7) % PALETTE.length]);
    if (mode === "plane") return plane.array[i] ? rgb(PALETTE[plane.array[i] % PALETTE.length]) : EDGE;
    const far = residuals?.[i];
    return far == null || Number.isNaN(far) ? NONE : SIGNED(0.5 + far / (2 * FAR));
  }

  /** Rings of a kind: outlines by quality just above the ground, traced rings at the eaves. */
  ringVertices(kind) {
    const rings = this.rings(kind), vertices = new Vertices(2 * rings.reduce((sum, one) => sum + one.places.length, 0));
    let row = 0;
    for (const { building, places } of rings) {
      const known = this.facts.attributes[building];
      const colour = kind === OUTLINE ? rgb(standingColour(known)) : rgb("#c2262e");
      const z = this.ringElevation(known, kind, places[0]);
      places.forEach((place, k) => {
        for (const [x, y] of [place, places[(k + 1) % places.length]]) vertices.set(row++, ...this.near([x, y, z]), colour);
      });
    }
    return vertices;
  }

  rings(kind) {
    const array = this.data.rings.array, places = this.data.ring_vertices.array, found = [];
    for (let at = 0; at < array.length; at += 4) {
      if (array[at + 1] !== kind) continue;
      const rows = Array.from({ length: array[at + 3] }, (_, k) => 2 * (array[at + 2] + k));
      found.push({ building: array[at], places: rows.map((row) => [places[row] / 1000, places[row + 1] / 1000]) });
    }
    return found;
  }

  ringElevation(known, kind, [x, y]) {
    const wanted = kind === OUTLINE ? known.ground_elevation : known.roof_elevation_min;
    if (wanted != null) return wanted * this.facts.unit - this.facts.origin[2] + 0.2;
    return (elevationAt(this.data.terrain, this.facts.terrain, x, y) ?? this.bounds[0][2]) + 0.2;
  }

  /** Box of one building [m], relative to the centre. */
  boxOf(row) {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    const see = (place) => place.forEach((value, axis) => {
      low[axis] = Math.min(low[axis], value);
      high[axis] = Math.max(high[axis], value);
    });
    for (const solid of this.solids().filter((one) => one.row === row))
      for (let t = solid.first; t < solid.first + solid.count; t++) for (let k = 0; k < 3; k++) see(this.near(this.corner(t, k)));
    for (const kind of [0, 1])
      for (const ring of this.rings(kind).filter((one) => one.building === row))
        for (const [x, y] of ring.places) see(this.near([x, y, this.ringElevation(this.facts.attributes[row], kind, [x, y])]));
    return Number.isFinite(low[2]) ? [low, high] : null;
  }
}
