// The map of hillshade and outlines, the histograms, and the pictures of the worst.

/** The terrain's usual slope is shaded as if it were this one [m/m]. */
const SHADED_SLOPE = 0.3;

function shade(relief, facts, context, place) {
  const [rows, columns] = relief.shape, image = context.createImageData(columns, rows);
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
  const raster = document.createElement("canvas");
  raster.width = columns;
  raster.height = rows;
  raster.getContext("2d").putImageData(image, 0, 0);
  const [left, top] = place(facts.west, facts.north);
  const [right, bottom] = place(facts.west + columns * facts.cell[0], facts.north - rows * facts.cell[1]);
  context.drawImage(raster, left, top, right - left, bottom - top);
}

class PlanMap {
  constructor(canvas, scene, select) {
    this.canvas = canvas;
    this.scene = scene;
    this.outlines = scene.rings(OUTLINE);
    if (!this.outlines.length) this.outlines = scene.rings(1);
    canvas.addEventListener("click", (event) => {
      const row = this.rowAt(event.offsetX, event.offsetY);
      if (row != null) select(row);
    });
  }

  bounds() {
    const { data, facts } = this.scene, name = data.overview ? "overview" : "terrain", [low, high] = this.scene.bounds;
    if (!data[name]) return [low[0], low[1], high[0], high[1]];
    const { west, north, cell } = facts[name], [rows, columns] = data[name].shape;
    return [west, north - rows * cell[1], west + columns * cell[0], north];
  }

  draw(selected) {
    const [west, south, east, north] = this.bounds(), width = this.canvas.clientWidth || 700;
    const ratio = window.devicePixelRatio || 1, scale = Math.min(width / (east - west), 640 / (north - south));
    const height = Math.max((north - south) * scale, 120), left = (width - (east - west) * scale) / 2;
    this.canvas.width = width * ratio;
    this.canvas.height = height * ratio;
    this.canvas.style.height = `${height}px`;
    this.place = (x, y) => [left + (x - west) * scale, (north - y) * scale];
    const context = this.canvas.getContext("2d"), { data, facts } = this.scene;
    context.scale(ratio, ratio);
    const name = data.overview ? "overview" : "terrain";
    if (data[name]) shade(data[name], facts[name], context, this.place);
    for (let at = 0; at < data.dots.array.length; at += 3) {
      const [x, y] = this.place(data.dots.array[at] / 10, data.dots.array[at + 1] / 10);
      context.fillStyle = data.dots.array[at + 2] ? STATUSES.good : STATUSES.poor;
      context.fillRect(x - 1, y - 1, 2, 2);
    }
    for (const { building, places } of this.outlines) this.drawRing(context, building, places, building === selected);
    this.drawScale(context, scale, height);
  }

  drawRing(context, building, places, isSelected) {
    const colour = standingColour(this.scene.facts.attributes[building]);
    context.beginPath();
    places.forEach(([x, y]) => context.lineTo(...this.place(x, y)));
    context.closePath();
    context.fillStyle = isSelected ? "#ffd433c0" : `${colour}55`;
    context.fill();
    context.lineWidth = isSelected ? 2.5 : 1.4;
    context.strokeStyle = isSelected ? "#8a6a00" : colour;
    context.stroke();
  }

  drawScale(context, scale, height) {
    const length = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000].find((one) => one * scale > 60) ?? 10000;
    context.fillStyle = "#ffffffcc";
    context.fillRect(8, height - 30, length * scale + 16, 24);
    context.fillStyle = "#1d2733";
    context.fillRect(16, height - 12, length * scale, 2);
    context.font = "12px sans-serif";
    context.fillText(`${length} m`, 16, height - 16);
  }

  rowAt(x, y) {
    const inside = this.outlines.filter(({ places }) => {
      const ring = places.map(([a, b]) => this.place(a, b));
      return ring.reduce((odd, [ax, ay], k) => {
        const [bx, by] = ring[(k + 1) % ring.length];
        return ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax ? !odd : odd;
      }, false);
    });
    return inside.length ? inside[inside.length - 1].building : null;
  }
}

/** An element of SVG with attributes and children. */
function svg(name, attributes = {}, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

function histogram({ title, counts, from, to, median }) {
  const most = Math.max(...counts), width = 560 / counts.length, x = (value) => 20 + (560 * (value - from)) / (to - from || 1);
  const bars = counts.map((count, k) =>
    svg("rect", { x: 20 + k * width, y: 125 - (85 * count) / most, width: width - 1, height: (85 * count) / most, fill: "#1769aa" }));
  const texts = [[20, from, "start"], [580, to, "end"]].map(([at, value, anchor]) =>
    svg("text", { x: at, y: 142, "font-size": 12, "text-anchor": anchor, fill: "#5b6876" }, value.toFixed(2)));
  return svg("svg", { viewBox: "0 0 600 150", preserveAspectRatio: "none", role: "img" },
    svg("text", { x: 20, y: 20, "font-size": 13, fill: "#1d2733" }, `${title}: median ${median.toFixed(3)}, tallest bar ${most} buildings`),
    ...bars, ...texts,
    svg("line", { x1: x(median), x2: x(median), y1: 32, y2: 128, stroke: "#d9432f", "stroke-width": 1.5 }));
}
