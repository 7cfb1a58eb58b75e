// The page at work: what is drawn when, and what the hand does.

class Viewer {
  constructor(data) {
    this.scene = new Scene(data);
    this.facts = data.facts;
    this.camera = new Camera();
    this.selected = 0;
    this.residuals = new Float32Array(data.classes.array.length).fill(NaN);
    this.measured = new Map();
    this.every = 1;
    this.map = new PlanMap(byId("map"), this.scene, (row) => this.select(row, true));
    this.fillControls();
    try {
      this.drawing = new Drawing(byId("canvas"));
    } catch (error) {
      this.say(error.message);
      return;
    }
    this.uploadAll();
    this.listen();
    this.home();
    if (!this.scene.levels.length && !data.classes.array.length) this.say("There is nothing to show: no models and no points.");
  }

  say(text) {
    byId("message").textContent = text;
    byId("message").hidden = false;
  }

  fillControls() {
    for (const level of this.scene.levels) byId("level").add(new Option(`LoD ${(level / 10).toFixed(1)}`, level));
    if (!this.scene.levels.length) byId("level").add(new Option("none", ""));
  }

  get level() {
    return Number(byId("level").value);
  }

  uploadAll() {
    const { drawing, scene } = this;
    drawing.upload("terrain", "surface", scene.terrainVertices(1), { when: "still" });
    drawing.upload("coarse", "surface", scene.terrainVertices(4), { when: "hasty" });
    this.uploadModels();
    this.uploadPoints();
    drawing.upload("outlines", "lines", scene.ringVertices(OUTLINE), { lift: 4e-5 });
    drawing.upload("traced", "lines", scene.ringVertices(1), { lift: 4e-5 });
    this.show();
  }

  uploadModels() {
    this.drawing.upload("models", "surface", this.scene.modelVertices(this.level, byId("roofs").value));
    this.drawing.upload("edges", "lines", this.scene.edgeVertices(this.level), { lift: 4e-5 });
  }

  uploadPoints() {
    const mode = byId("points").value;
    if (mode === "residual") this.facts.names.forEach((_, row) => this.measure(row));
    const vertices = this.scene.pointVertices(mode, this.residuals), [low, high] = this.scene.bounds;
    const spacing = Math.sqrt(((high[0] - low[0]) * (high[1] - low[1])) / Math.max(vertices.count, 1));
    this.drawing.upload("points", "points", vertices, { size: Math.min(Math.max(spacing * 0.55, 0.06), 1.5), lift: 2e-5 });
  }

  /** Return what the points say of a building's faces at the level that is shown. */
  measure(row) {
    const key = `${row} ${this.level}`;
    if (!this.measured.has(key)) this.measured.set(key, measureBuilding(this.scene, row, this.level, this.residuals));
    return this.measured.get(key);
  }

  show() {
    for (const name of ["models", "edges", "points", "terrain", "outlines", "traced"])
      this.drawing.layers[name].is_shown = byId(`show-${name}`).checked;
    this.drawing.layers.coarse.is_shown = byId("show-terrain").checked;
    this.drawing.layers.edges.is_shown &&= byId("show-models").checked;
    this.fillLegend();
    this.redraw();
  }

  fillLegend() {
    const legend = byId("legend"), title = (text) => Object.assign(document.createElement("div"), { className: "legend-title", textContent: text });
    legend.replaceChildren();
    if (byId("show-models").checked && this.scene.levels.length) {
      const mode = byId("roofs").value;
      if (mode === "slope") legend.append(title("slope"), ...[0, 15, 30, 45, 60].map((one) => key(css(SLOPES(one / 60)), `${one}°`)));
      if (mode === "type") legend.append(title("roof type"), ...this.scene.types.map((one, k) => key(PALETTE[k % PALETTE.length], one)));
      if (mode === "quality") legend.append(title("quality"), ...this.standings());
      if (mode === "rmse") legend.append(title("rmse"), ...[0, 0.15, 0.3].map((one) => key(css(GOODNESS(one / FAR)), `${one} m`)));
      if (mode === "aspect") legend.append(title("looks to"), ...["N", "NE", "E", "SE", "S", "SW", "W", "NW"].map((one, k) => key(PALETTE[k], one)));
    }
    if (byId("show-points").checked && this.residuals.length) {
      const mode = byId("points").value;
      if (mode === "class") legend.append(title("points"), ...this.classKeys());
      if (mode === "residual") legend.append(title("points"), ...[-FAR, 0, FAR].map((one) => key(css(SIGNED(0.5 + one / (2 * FAR))), `${one} m`)));
    }
  }

  standings() {
    const counts = {};
    for (const one of this.facts.attributes) counts[standing(one)] = (counts[standing(one)] ?? 0) + 1;
    return Object.entries(counts).map(([name, n]) => key(STATUSES[name] ?? STATUSES.unknown, `${name} (${n})`));
  }

  classKeys() {
    const there = new Set(this.scene.data.classes.array.map((one) => one & ~FACADE));
    return [...there].sort((a, b) => a - b).map((one) => key(CLASSES[one] ?? "#b9b9b9", this.facts.class_names[one] ?? `class ${one}`));
  }

  listen() {
    const canvas = byId("canvas"), changed = (id, act) => byId(id).addEventListener("change", act);
    changed("level", () => { this.measured.clear(); this.uploadModels(); if (byId("points").value === "residual") this.uploadPoints(); this.show(); this.fillPanel(); });
    changed("roofs", () => { this.uploadModels(); this.show(); });
    changed("points", () => { this.uploadPoints(); this.show(); });
    for (const name of ["models", "edges", "points", "terrain", "outlines", "traced"]) changed(`show-${name}`, () => this.show());
    byId("home").addEventListener("click", () => this.home());
    byId("top").addEventListener("click", () => { this.camera.tilt = Math.PI / 2; this.camera.azimuth = 0; this.redraw(); });
    canvas.addEventListener("pointerdown", (event) => this.drag(event));
    canvas.addEventListener("wheel", (event) => { event.preventDefault(); this.camera.approach(event.deltaY * 0.0012); this.redraw(true); }, { passive: false });
    canvas.addEventListener("dblclick", (event) => { const row = this.rowUnder(event); if (row != null) this.select(row, true); });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    new ResizeObserver(() => { this.redraw(); this.map.draw(this.selected - 1); }).observe(canvas.parentElement);
  }

  drag(down) {
    const canvas = byId("canvas");
    let [x, y, isClick] = [down.clientX, down.clientY, true];
    canvas.setPointerCapture(down.pointerId);
    const move = (event) => {
      const [dx, dy] = [event.clientX - x, event.clientY - y];
      if (isClick && Math.hypot(dx, dy) < 4) return;
      [x, y, isClick] = [event.clientX, event.clientY, false];
      if (down.button === 2 || down.shiftKey) this.camera.move(dx, dy, canvas.clientHeight);
      else this.camera.turn(dx, dy);
      this.redraw(true);
    };
    const up = (event) => {
      canvas.removeEventListener("pointermove", move);
      canvas.removeEventListener("pointerup", up);
      if (isClick && down.button === 0) this.select(this.rowUnder(event), false);
      this.redraw();
    };
    canvas.addEventListener("pointermove", move);
    canvas.addEventListener("pointerup", up);
  }

  rowUnder(event) {
    const ratio = window.devicePixelRatio || 1;
    const owner = this.drawing.owner(this.camera, Math.round(event.offsetX * ratio), Math.round(event.offsetY * ratio));
    return owner ? owner - 1 : null;
  }

  select(row, isCentred) {
    this.selected = row == null ? 0 : row + 1;
    this.fillPanel();
    this.map.draw(row);
    if (!this.drawing) return;
    const box = row == null ? null : this.scene.boxOf(row);
    if (isCentred && box) {
      this.camera.frame(box, this.aspect, 1.5);
      byId("view").scrollIntoView({ block: "nearest" });
    }
    this.redraw();
  }

  fillPanel() {
    const panel = byId("panel"), row = this.selected - 1;
    if (row < 0) {
      panel.replaceChildren(element("h2", "Building"), element("p", "Click a building to see what is known of it."));
      return;
    }
    const known = this.facts.attributes[row], told = (name, reason) => known[name] ? [element("p", `${known[name]}${known[reason] ? `: ${known[reason]}` : ""}`)] : [];
    const lines = [...told("quality", "quality_reasons"), ...told("status", "reason")];
    for (const one of lines.slice(0, 1)) Object.assign(one, { className: "status" }).style.color = standingColour(known);
    const names = Object.keys(known).filter((name) => !["quality", "quality_reasons", "status", "reason"].includes(name) && known[name] != null && known[name] !== "");
    panel.replaceChildren(element("h2", this.facts.names[row]), ...lines, table(names.map((name) => [name, written(known[name])])), ...this.faceRows(row));
  }

  faceRows(row) {
    const { faces, n } = this.measure(row);
    if (!faces.length) return [];
    const rows = faces.slice(0, 40).map((one) => [`${one.number}`, `${one.slope.toFixed(0)}°`, `${one.area.toFixed(1)} m²`, `${one.n}`, one.rmse == null ? "–" : `${one.rmse.toFixed(3)} m`]);
    const more = faces.length > rows.length ? [element("p", `and ${faces.length - rows.length} smaller ones`)] : [];
    return [element("h3", `Roof faces at LoD ${(this.level / 10).toFixed(1)}`), table([["face", "slope", "area", "points", "rmse"], ...rows]), ...more,
      element("p", `From the ${n.toLocaleString("en")} points of the building that the page holds.`)];
  }

  home() {
    const { scene, camera } = this;
    camera.azimuth = -0.6;
    camera.tilt = 0.7;
    const box = this.facts.focus == null ? null : scene.boxOf(this.facts.focus);
    camera.frame(box ?? scene.bounds.map((place) => scene.near(place)), this.aspect, box ? 1.5 : 1.08);
    this.redraw();
  }

  get aspect() {
    return byId("canvas").clientWidth / Math.max(byId("canvas").clientHeight, 1);
  }

  /** Draw in the next frame; while the hand is at work with fewer points if frames take long. */
  redraw(isMoving = false) {
    this.isMoving = isMoving;
    this.pending ??= requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.pending = null;
    if (!this.drawing) return;
    const canvas = byId("canvas"), ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio].map(Math.round);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    if (this.isMoving) this.time(now);
    this.drawing.draw(this.camera, this.selected, this.isMoving ? this.every : 1);
    if (this.isMoving) {
      clearTimeout(this.rest);
      this.rest = setTimeout(() => { this.lastFrame = null; this.redraw(); }, 600);
    }
  }

  time(now) {
    const taken = now - (this.lastFrame ?? now);
    this.lastFrame = now;
    if (!taken || taken > 5000) return;
    this.average = 0.8 * (this.average ?? taken) + 0.2 * taken;
    if (this.average > 45 && this.every < 8) { this.every *= 2; this.average = 33; }
    else if (this.average < 18 && this.every > 1) { this.every /= 2; this.average = 25; }
    const shown = Math.floor(this.residuals.length / this.every).toLocaleString("en");
    byId("speed").textContent = `${(1000 / this.average).toFixed(0)} frames/s, ${shown} points`;
  }

  /** Draw a building on a small canvas of its own, points by their distance to it. */
  picture(canvas, row) {
    const large = this.drawing.canvas, size = [large.width, large.height], camera = new Camera();
    const box = this.scene.boxOf(row);
    if (!box) return;
    camera.frame(box, 520 / 340, 1.2);
    [large.width, large.height] = [canvas.width, canvas.height] = [520, 340];
    const mine = this.scene.pointVertices("residual", this.residuals, this.scene.ranges.get(row + 1) ?? [0, 0]);
    this.drawing.upload("mine", "points", mine, { size: this.drawing.layers.points.size, lift: 2e-5 });
    this.drawing.draw(camera, row + 1);
    canvas.getContext("2d").drawImage(large, 0, 0);
    [large.width, large.height] = size;
  }

  drawWorst() {
    const worst = this.facts.worst;
    byId("worst-section").hidden = !worst.length;
    if (!worst.length || !this.drawing) return;
    const { layers } = this.drawing, own = layers.points;
    const cards = worst.map(({ row, why }) => {
      const card = element("button", ""), canvas = document.createElement("canvas"), text = element("p", why);
      card.className = "card";
      text.prepend(element("b", this.facts.names[row]));
      card.append(canvas, text);
      card.addEventListener("click", () => this.select(row, true));
      this.measure(row);
      return { card, canvas, row };
    });
    own.is_shown = false;
    for (const { canvas, row } of cards) this.picture(canvas, row);
    own.is_shown = byId("show-points").checked;
    delete layers.mine;
    byId("worst").replaceChildren(...cards.map(({ card }) => card));
    this.redraw();
  }
}

async function openPage() {
  const data = await loadData(), viewer = new Viewer(data);
  byId("map-legend").append(...viewer.standings());
  const bars = data.facts.histograms.map(histogram);
  byId("histograms").append(...(bars.length ? bars : ["There is nothing to be measured."]));
  viewer.map.draw(-1);
  viewer.drawWorst();
  if (data.facts.focus != null) viewer.select(data.facts.focus, true);
  window.viewer = viewer;
  document.body.dataset.state = "ready";
}

openPage().catch((error) => {
  byId("message").textContent = `The page cannot be shown: ${error.message}`;
  byId("message").hidden = false;
  console.error(error);
});
