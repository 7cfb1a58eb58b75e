// The map: hillshade and outlines, north up, to be moved and zoomed.

/** The terrain's usual slope is shaded as if it were this one [m/m]. */
const SHADED_SLOPE = 0.3;

/** Return a canvas with the hillshade of a raster, a pixel a cell. */
function hillshade(relief, facts) {
  const [rows, columns] = relief.shape, raster = element("canvas", { width: columns, height: rows });
  const context = raster.getContext("2d"), image = context.createImageData(columns, rows);
  const at = (r, c) => {
    const steps = relief.array[Math.min(Math.max(r, 0), rows - 1) * columns + Math.min(Math.max(c, 0), columns - 1)];
    return steps === facts.unknown ? null : facts.middle + steps * facts.step;
  };
  const slopes = (r, c, middle) => [
    ((at(r, c + 1) ?? middle) - (at(r, c - 1) ?? middle)) / (2 * facts.cell[0]),
    ((at(r - 1, c) ?? middle) - (at(r + 1, c) ?? middle)) / (2 * facts.cell[1]),
  ];
  const known = [];
  for (let k = 0; k < rows * columns; k += 7) {
    const [r, c] = [Math.floor(k / columns), k % columns], middle = at(r, c);
    if (middle != null) known.push(Math.hypot(...slopes(r, c, middle)));
  }
  const usual = known.sort((a, b) => a - b)[Math.floor(known.length * 0.7)] || 1, relief_of = Math.min(SHADED_SLOPE / usual, 4);
  for (let r = 0; r < rows; r++)
    for (let c = 0; c < columns; c++) {
      const pixel = 4 * (r * columns + c), middle = at(r, c);
      if (middle == null) continue;
      const [east, north] = slopes(r, c, middle).map((one) => one * relief_of);
      // from the north-west, 45 degrees high
      const light = Math.max((east - north) / Math.SQRT2 + 1, 0) / Math.hypot(east, north, 1) / Math.SQRT2;
      const grey = 255 * (0.3 + 0.68 * light);
      image.data.set([grey, grey, grey * 0.97, 255], pixel);
    }
  context.putImageData(image, 0, 0);
  return raster;
}

class PlanMap {
  constructor(canvas, scene, select) {
    this.canvas = canvas;
    this.scene = scene;
    this.selected = -1;
    this.outlines = this.paths(OUTLINE);
    if (!this.outlines.size) this.outlines = this.paths(1);
    const { data, facts } = scene, name = data.overview ? "overview" : "terrain";
    this.relief = data[name] ? { ...facts[name], shape: data[name].shape, raster: hillshade(data[name], facts[name]) } : null;
    this.hand = new Hand(canvas, {
      drag: (from, to) => this.move(to[0] - from[0], to[1] - from[1]),
      zoom: (factor, at) => this.zoom(1 / factor, at),
      tap: (at) => this.goTo(at) || select(this.rowAt(at)),
      wantsWheel: (event) => event.ctrlKey || document.activeElement === canvas,
    });
    canvas.addEventListener("keydown", (event) => this.pressed(event));
  }

  /** Building → its rings of a kind as one path, so that courtyards stay empty. */
  paths(kind) {
    const found = new Map();
    for (const { building, places } of this.scene.rings(kind)) {
      if (!found.has(building)) found.set(building, new Path2D());
      const path = found.get(building);
      places.forEach(([x, y], k) => (k ? path.lineTo(x, y) : path.moveTo(x, y)));
      path.closePath();
    }
    return found;
  }

  bounds() {
    const [low, high] = this.scene.bounds;
    if (!this.relief) return [low[0], low[1], high[0], high[1]];
    const { west, north, cell, shape: [rows, columns] } = this.relief;
    return [west, north - rows * cell[1], west + columns * cell[0], north];
  }

  /** Show all of it. */
  home() {
    const [west, south, east, north] = this.bounds();
    this.whole = Math.min(this.canvas.clientWidth / (east - west), this.canvas.clientHeight / (north - south));
    this.scale = this.whole;
    this.middle = [(west + east) / 2, (south + north) / 2];
    this.draw();
  }

  move(dx, dy) {
    this.middle = [this.middle[0] - dx / this.scale, this.middle[1] + dy / this.scale];
    this.draw();
  }

  zoom(factor, [x, y] = [this.canvas.clientWidth / 2, this.canvas.clientHeight / 2]) {
    const scale = clamped(this.scale * factor, this.whole / 2, 200), own = 1 / this.scale - 1 / scale;
    this.middle = [this.middle[0] + (x - this.canvas.clientWidth / 2) * own, this.middle[1] - (y - this.canvas.clientHeight / 2) * own];
    this.scale = scale;
    this.draw();
  }

  pressed(event) {
    const steps = { ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] }[event.key];
    if (steps) this.move(...steps);
    else if (event.key === "+" || event.key === "=") this.zoom(1.4);
    else if (event.key === "-") this.zoom(1 / 1.4);
    else if (event.key === "h" || event.key === "Home") this.home();
    else return;
    event.preventDefault();
  }

  /** Mark a building, and bring it into the picture. */
  select(row) {
    this.selected = row ?? -1;
    const box = row == null ? null : this.scene.boxOf(row);
    if (box && this.scale) {
      const at = [0, 1].map((axis) => (box[0][axis] + box[1][axis]) / 2 + this.scene.centre[axis]);
      const [wide, high] = [this.canvas.clientWidth, this.canvas.clientHeight].map((size) => size / 2 / this.scale);
      if (Math.abs(at[0] - this.middle[0]) > wide * 0.9 || Math.abs(at[1] - this.middle[1]) > high * 0.9) this.middle = at;
    }
    this.draw();
  }

  /** Set metres of the map frame as the unit of a context. */
  place(context) {
    const { scale, middle, canvas } = this, ratio = window.devicePixelRatio || 1;
    context.setTransform(scale * ratio, 0, 0, -scale * ratio, (canvas.clientWidth / 2 - middle[0] * scale) * ratio, (canvas.clientHeight / 2 + middle[1] * scale) * ratio);
  }

  draw() {
    const { canvas, relief, scene } = this, ratio = window.devicePixelRatio || 1, [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!this.scale || !width) return;
    Object.assign(canvas, { width: width * ratio, height: height * ratio });
    const context = canvas.getContext("2d");
    this.place(context);
    if (relief) {
      context.save();
      context.translate(relief.west, relief.north);
      context.scale(relief.cell[0], -relief.cell[1]);
      context.globalAlpha = isDark() ? 0.55 : 1;
      context.drawImage(relief.raster, 0, 0);
      context.restore();
    }
    for (let at = 0, dots = scene.data.dots.array; at < dots.length; at += 3) {
      context.fillStyle = STATUSES[["poor", "check", "good"][dots[at + 2]]];
      context.fillRect(dots[at] / 10 - 1 / this.scale, dots[at + 1] / 10 - 1 / this.scale, 2 / this.scale, 2 / this.scale);
    }
    for (const [row, path] of this.outlines) if (row !== this.selected) this.drawBuilding(context, path, standingColour(scene.facts.attributes[row]), scene.dimmed.has(row) ? 0.15 : 0.55, 1.2);
    const chosen = this.outlines.get(this.selected);
    if (chosen) this.drawBuilding(context, chosen, "#1a85ff", 0.75, 3);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.drawMarks(context, width, height);
  }

  drawBuilding(context, path, colour, strength, wide) {
    context.fillStyle = context.strokeStyle = colour;
    context.globalAlpha = strength;
    context.fill(path, "evenodd");
    context.globalAlpha = Math.min(strength * 1.8, 1);
    context.lineWidth = wide / this.scale;
    context.stroke(path);
    context.globalAlpha = 1;
  }

  /** North and the scale. */
  drawMarks(context, width, height) {
    const length = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000].find((one) => one * this.scale > 60) ?? 10000;
    context.fillStyle = "#ffffffd0";
    context.fillRect(8, height - 30, length * this.scale + 16, 24);
    context.beginPath();
    context.arc(width - 26, 26, 18, 0, 2 * Math.PI);
    context.fill();
    context.fillStyle = "#1d2733";
    context.fillRect(16, height - 12, length * this.scale, 2);
    context.font = "12px sans-serif";
    context.fillText(`${length} m`, 16, height - 16);
    context.fill(new Path2D(`M${width - 26} 11 l5 9 h-10 z`));
    context.textAlign = "center";
    context.fillText("N", width - 26, 35);
  }

  /** Of a served page: ask for the buildings round a dot. */
  goTo([x, y]) {
    const dots = this.scene.data.dots.array, { canvas, middle, scale } = this;
    if (!this.scene.facts.is_served || this.rowAt([x, y]) != null) return false;
    const [east, north] = [middle[0] + (x - canvas.clientWidth / 2) / scale, middle[1] - (y - canvas.clientHeight / 2) / scale];
    for (let at = 0; at < dots.length; at += 3)
      if (Math.hypot(dots[at] / 10 - east, dots[at + 1] / 10 - north) * scale < 12) return location.assign(`?at=${east.toFixed(1)},${north.toFixed(1)}`), true;
    return false;
  }

  rowAt([x, y]) {
    const context = this.canvas.getContext("2d"), ratio = window.devicePixelRatio || 1;
    this.place(context);
    return [...this.outlines].filter(([, path]) => context.isPointInPath(path, x * ratio, y * ratio, "evenodd")).pop()?.[0] ?? null;
  }
}
