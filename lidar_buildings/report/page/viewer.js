// The page at work: what is drawn when, and what hand, keys and links do.

const LAYERS = ["models", "edges", "points", "terrain", "outlines", "traced"];
/** Where the eye looks from at first, on wide screens and on tall ones. */
const RESTING = { tilt: 0.62, azimuth: -0.6 }, STANDING = { tilt: 0.95, azimuth: -0.25 };

class Viewer {
  constructor(data) {
    this.scene = new Scene(data);
    this.facts = data.facts;
    this.camera = new Camera();
    this.selected = 0;
    this.residuals = new Float32Array(data.classes.array.length).fill(NaN);
    this.measured = new Map();
    this.haste = 1;
    this.fillControls();
    this.map = new PlanMap(byId("map"), this.scene, (row) => this.select(row, true));
    try {
      this.drawing = new Drawing(byId("canvas"));
    } catch (error) {
      this.say(error.message);
    }
    if (this.drawing) this.start();
    this.table = new BuildingTable(this.facts, { select: (row) => { this.select(row, true); byId("view").scrollIntoView(); }, filter: (rows) => this.filter(rows) });
    this.listenToPage();
    this.map.home();
  }

  start() {
    this.field = new Field(this.scene);
    this.camera.solidAt = (x, y) => this.field.solidAt(x, y);
    this.drawing.setField(this.field);
    this.uploadAll();
    this.listen();
    this.home(false);
    if (!this.scene.levels.length && !this.residuals.length) this.say("There is nothing to show: no models and no points.");
  }

  say(text) {
    byId("message").textContent = text;
    byId("message").hidden = false;
  }

  fillControls() {
    for (const level of this.scene.levels) byId("level").add(new Option(`LoD ${(level / 10).toFixed(1)}`, level));
    if (!this.scene.levels.length) {
      byId("level").add(new Option("none", ""));
      byId("show-points").checked = true;
    }
    if (this.scene.data.colours) byId("points").add(new Option("colour", "colour"));
  }

  get level() {
    return Number(byId("level").value);
  }

  uploadAll() {
    const { drawing, scene } = this;
    drawing.upload("terrain", "terrain", terrainVertices(scene, 150), { when: "still" });
    drawing.upload("coarse", "terrain", terrainVertices(scene, 60), { when: "hasty" });
    this.uploadModels();
    drawing.upload("outlines", "lines", scene.ringVertices(OUTLINE));
    drawing.upload("traced", "lines", scene.ringVertices(1));
    this.show();
  }

  uploadSurfaces() {
    this.drawing.upload("models", "surface", this.scene.modelVertices(this.level, byId("roofs").value, this.field));
  }

  uploadModels() {
    this.uploadSurfaces();
    this.drawing.upload("edges", "lines", this.scene.edgeVertices(this.level), { strength: 0.5 });
    this.drawing.castShadows(this.scene.bounds.map((place) => this.scene.near(place)));
  }

  /** Points are put on the card when they are first shown. */
  uploadPoints() {
    const mode = byId("points").value;
    if (mode === "residual") this.facts.names.forEach((_, row) => this.measure(row));
    const vertices = this.scene.pointVertices(mode, this.residuals), [low, high] = this.scene.bounds;
    const spacing = Math.sqrt(((high[0] - low[0]) * (high[1] - low[1])) / Math.max(vertices.count, 1));
    this.drawing.upload("points", "points", vertices, { size: clamped(spacing * 0.55, 0.06, 1.5) });
  }

  /** Return what the points say of a building's faces at the level that is shown. */
  measure(row) {
    const key = `${row} ${this.level}`;
    if (!this.measured.has(key)) this.measured.set(key, measureBuilding(this.scene, row, this.level, this.residuals));
    return this.measured.get(key);
  }

  show() {
    const { layers } = this.drawing, isShown = (name) => byId(`show-${name}`).checked;
    if (isShown("points") && !layers.points) this.uploadPoints();
    for (const name of LAYERS) if (layers[name]) layers[name].is_shown = isShown(name);
    layers.coarse.is_shown = layers.terrain.is_shown;
    layers.edges.is_shown &&= isShown("models");
    this.drawing.castShadows(this.scene.bounds.map((place) => this.scene.near(place)));
    this.fillLegend();
    this.redraw();
  }

  /** Show the buildings of these rows in colour, the others without. */
  filter(rows) {
    const kept = new Set(rows), isSame = this.facts.names.length - this.scene.dimmed.size === kept.size && rows.every((row) => !this.scene.dimmed.has(row));
    if (isSame) return;
    this.scene.dimmed = new Set(this.facts.names.map((_, row) => row).filter((row) => !kept.has(row)));
    clearTimeout(this.filtering);
    this.filtering = setTimeout(() => {
      if (this.drawing) this.uploadSurfaces();
      this.map.draw();
      this.redraw();
    }, 150);
  }

  fillLegend() {
    const legend = byId("legend"), title = (text) => element("div", { className: "legend-title", textContent: text });
    legend.replaceChildren();
    if (byId("show-models").checked && this.scene.levels.length) {
      const mode = byId("roofs").value;
      if (mode === "slope") legend.append(title("roofs by slope"), ...[0, 15, 30, 45, 60].map((one) => key(css(SLOPES(one / 60)), `${one}°${one === 60 ? " and more" : ""}`)));
      if (mode === "type") legend.append(title("roof type"), ...this.scene.types.map((one, k) => key(PALETTE[k % PALETTE.length], one)));
      if (mode === "quality") legend.append(title("grade"), ...this.standings());
      if (mode === "rmse") legend.append(title("rmse"), ...[0, 0.15, 0.3].map((one) => key(css(GOODNESS(one / FAR)), `${one} m${one === FAR ? " and more" : ""}`)));
      if (mode === "aspect") legend.append(title("looks to"), ...["N", "NE", "E", "SE", "S", "SW", "W", "NW"].map((one, k) => key(PALETTE[k], one)));
    }
    if (byId("show-points").checked && this.residuals.length) {
      const mode = byId("points").value;
      if (mode === "class") legend.append(title("points"), ...this.classKeys());
      if (mode === "residual") legend.append(title("points off the model"), ...[-FAR, 0, FAR].map((one) => key(css(SIGNED(0.5 + one / (2 * FAR))), `${one} m`)));
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
    const changed = (id, act) => byId(id).addEventListener("change", act);
    changed("level", () => { this.measured.clear(); this.uploadModels(); if (byId("points").value === "residual") this.uploadPoints(); this.show(); this.refill(); });
    changed("roofs", () => { this.uploadSurfaces(); this.show(); });
    changed("points", () => { byId("show-points").checked = true; this.uploadPoints(); this.show(); });
    for (const name of LAYERS) changed(`show-${name}`, () => this.show());
    const press = (id, act) => byId(id).addEventListener("click", act);
    press("home", () => this.home());
    press("top", () => this.fly({ tilt: Math.PI / 2, azimuth: 0 }));
    press("compass", () => this.fly({ azimuth: 0 }));
    press("nearer", () => this.zoom(0.6));
    press("farther", () => this.zoom(1 / 0.6));
    this.hand = new Hand(byId("canvas"), {
      down: (at) => { this.flight = null; this.pivot = this.placeUnder(at); },
      drag: (from, to, isMove) => {
        if (isMove) this.camera.move(this.inPicture(from), this.inPicture(to), this.aspect, this.pivot[2]);
        else this.camera.turn(-(to[0] - from[0]) * 0.006, (to[1] - from[1]) * 0.006, this.pivot);
        this.moved();
      },
      zoom: (factor, at) => this.zoom(factor, at),
      twist: (angle) => { this.camera.turn(angle, 0, this.pivot); this.moved(); },
      tap: (at) => this.select(this.rowUnder(at), false),
      double: (at) => { const row = this.rowUnder(at); if (row != null) this.select(row, true); },
      up: () => this.redraw(),
    });
    byId("canvas").addEventListener("keydown", (event) => this.pressed(event));
    new ResizeObserver(() => this.redraw()).observe(byId("canvas"));
  }

  listenToPage() {
    new ResizeObserver(() => this.map.home()).observe(byId("map"));
    byId("map-nearer").addEventListener("click", () => this.map.zoom(1.5));
    byId("map-farther").addEventListener("click", () => this.map.zoom(1 / 1.5));
    byId("map-home").addEventListener("click", () => this.map.home());
    const repaint = () => { this.map.draw(); this.redraw(); };
    byId("theme").addEventListener("click", () => { document.documentElement.style.colorScheme = isDark() ? "light" : "dark"; repaint(); });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
    addEventListener("hashchange", () => this.follow());
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && !event.target.matches("input, select")) this.select(null);
      if (event.key !== "/" || event.target.matches("input, select")) return;
      event.preventDefault();
      byId("search").focus();
    });
  }

  /** Go to the building that the address names. */
  follow() {
    const name = new URLSearchParams(location.hash.slice(1)).get("building"), row = this.facts.names.indexOf(name ?? "");
    if (row >= 0 && row !== this.selected - 1) this.select(row, true);
    const asked = new URLSearchParams(location.search).get("building");
    if (row < 0 && name && this.facts.is_served && asked !== name) location.search = `?building=${encodeURIComponent(name)}`;
    return row >= 0;
  }

  pressed(event) {
    const { camera } = this, step = this.canvas.clientHeight / 8, middle = [this.canvas.clientWidth / 2, this.canvas.clientHeight / 2];
    const arrows = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    const acts = {
      "+": () => this.zoom(0.8), "=": () => this.zoom(0.8), "-": () => this.zoom(1.25), PageUp: () => camera.turn(0, 0.1, camera.target),
      PageDown: () => camera.turn(0, -0.1, camera.target), q: () => camera.turn(0.15, 0, camera.target), e: () => camera.turn(-0.15, 0, camera.target),
      h: () => this.home(), Home: () => this.home(), t: () => byId("top").click(), n: () => byId("compass").click(), f: () => this.flyTo(this.selected - 1),
    };
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (arrows && event.shiftKey) camera.turn(-arrows[0] * 0.12, arrows[1] * 0.08, camera.target);
    else if (arrows) camera.move(this.inPicture(middle), this.inPicture([middle[0] + arrows[0] * step, middle[1] + arrows[1] * step]), this.aspect, camera.target[2]);
    else if (acts[event.key]) acts[event.key]();
    else return;
    event.preventDefault();
    this.moved();
  }

  get canvas() {
    return byId("canvas");
  }

  get aspect() {
    return this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1);
  }

  /** A place of the canvas [pixels from its upper left] as one of the picture, -1 to 1. */
  inPicture([x, y]) {
    return [(2 * x) / this.canvas.clientWidth - 1, 1 - (2 * y) / this.canvas.clientHeight];
  }

  pick([x, y]) {
    const { canvas } = this;
    return this.drawing.pick(this.camera, (x * canvas.width) / canvas.clientWidth, (y * canvas.height) / canvas.clientHeight);
  }

  rowUnder(at) {
    return (this.pick(at)?.owner ?? 0) - 1 < 0 ? null : this.pick(at).owner - 1;
  }

  /** What is seen at a place of the canvas; where that is the sky, the target's level or the target. */
  placeUnder(at) {
    return this.pick(at)?.place ?? this.camera.onLevel(this.inPicture(at), this.aspect, this.camera.target[2]) ?? this.camera.target;
  }

  /** Come nearer by a factor, to what is under a place of the canvas, or to the middle; wheels turn in bursts. */
  zoom(factor, at = [this.canvas.clientWidth / 2, this.canvas.clientHeight / 2]) {
    const now = performance.now(), last = this.lastZoom;
    const isNew = !last || now - last.time > 300 || Math.hypot(at[0] - last.at[0], at[1] - last.at[1]) > 3;
    this.lastZoom = { time: now, at, place: isNew ? this.placeUnder(at) : last.place };
    this.flight = null;
    this.camera.zoom(factor, this.lastZoom.place);
    this.moved();
  }

  moved() {
    this.camera.keepOut();
    this.redraw(true);
  }

  /** Go from here to another state of the camera in a moment. */
  fly(wanted) {
    this.flight = { from: this.camera.state, to: { ...this.camera.state, ...wanted }, start: null, time: matchMedia("(prefers-reduced-motion: reduce)").matches ? 1 : 700 };
    this.redraw(true);
  }

  flyTo(row) {
    const box = row < 0 ? null : this.scene.boxOf(row), goal = new Camera();
    if (!box) return;
    goal.solidAt = this.camera.solidAt;
    Object.assign(goal, { azimuth: this.camera.azimuth, tilt: clamped(this.camera.tilt, 0.5, 0.9) });
    goal.frame(box, this.aspect, this.aspect < 0.8 ? 2.2 : 1.9);
    goal.distance = Math.max(goal.distance, 45);
    const top = [...goal.target.slice(0, 2), box[1][2]];
    while (goal.isHidden(top) && goal.tilt < 1.4) goal.tilt += 0.05;
    goal.keepOut();
    // where the panel covers the lower half, the building stands in the upper one
    if (this.aspect < 0.8) goal.target = goal.target.map((value, axis) => value - goal.axes()[1][axis] * 0.5 * Math.tan(FIELD / 2) * goal.distance);
    this.fly(goal.state);
  }

  home(isFlight = true) {
    const { scene, facts } = this, goal = new Camera(), box = facts.focus == null ? null : scene.boxOf(facts.focus);
    Object.assign(goal, this.aspect < 0.8 ? STANDING : RESTING);
    goal.frame(box ?? scene.bounds.map((place) => scene.near(place)), this.aspect, box ? 1.5 : this.aspect < 0.8 ? 0.8 : 1);
    this.fly(goal.state);
    if (isFlight) return;
    this.camera.between(goal.state, goal.state, 1);
    this.flight = null;
  }

  select(row, isFlight) {
    this.selected = row == null ? 0 : row + 1;
    const address = row == null ? location.pathname + location.search : `#building=${encodeURIComponent(this.facts.names[row])}`;
    if (row != null || location.hash.startsWith("#building=")) history.replaceState(null, "", address);
    this.refill();
    this.map.select(row);
    this.table.select(row);
    if (!this.drawing) return;
    if (row != null && isFlight) this.flyTo(row);
    this.redraw();
  }

  refill() {
    const row = this.selected - 1;
    if (row < 0) byId("panel").hidden = true;
    else fillPanel(byId("panel"), this.facts, row, this.measure(row), this.level, { fly: () => this.flyTo(row), close: () => this.select(null) });
  }

  /** Draw in the next frame; while something moves, at once and as finely as time allows. */
  redraw(isMoving = false) {
    this.isMoving = isMoving || this.flight != null;
    this.pending ??= requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.pending = null;
    if (!this.drawing || this.canvas.clientWidth === 0) return;
    if (this.flight) this.continueFlight(now);
    const { canvas, isMoving } = this, ratio = (window.devicePixelRatio || 1) / (isMoving ? Math.min(this.haste, 3) : 1);
    const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio].map(Math.round);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    this.drawing.draw(this.camera, { selected: this.selected, every: isMoving ? 2 ** Math.floor(this.haste - 1) : 1, isSmooth: !isMoving, pale: byId("show-points").checked ? 0.75 : 0 });
    byId("needle").style.transform = `rotate(${this.camera.azimuth}rad)`;
    if (!isMoving) return;
    this.time(now);
    clearTimeout(this.rest);
    this.rest = setTimeout(() => { this.lastFrame = null; this.redraw(); }, 250);
    if (this.flight) this.redraw(true);
  }

  continueFlight(now) {
    const { flight } = this, share = Math.min((now - (flight.start ??= now)) / flight.time, 1);
    this.camera.between(flight.from, flight.to, share * share * (3 - 2 * share));
    this.camera.keepOut();
    if (share === 1) this.flight = null;
    this.isMoving = true;
  }

  /** Draw more coarsely while frames take long, more finely while they do not. */
  time(now) {
    const taken = now - (this.lastFrame ?? now);
    this.lastFrame = now;
    if (!taken || taken > 2000) return;
    this.average = 0.7 * (this.average ?? taken) + 0.3 * taken;
    if (this.average > 40 && this.haste < 4) [this.haste, this.average] = [this.haste + (this.average > 80 ? 1 : 0.5), 30];
    else if (this.average < 17 && this.haste > 1) [this.haste, this.average] = [this.haste - 0.5, 25];
  }

  /** Draw a building on a small canvas of its own, points by their distance to it. */
  picture(canvas, row) {
    const { drawing, scene } = this, large = drawing.canvas, size = [large.width, large.height], camera = new Camera(), box = scene.boxOf(row);
    if (!box) return;
    camera.frame(box, 520 / 340, 1.3);
    [large.width, large.height] = [canvas.width, canvas.height] = [520, 340];
    const mine = scene.pointVertices("residual", this.residuals, scene.ranges.get(row + 1) ?? [0, 0]);
    drawing.upload("mine", "points", mine, { size: 0.25 });
    drawing.draw(camera, { pale: 0.75 });
    canvas.getContext("2d").drawImage(large, 0, 0);
    [large.width, large.height] = size;
  }

  drawWorst() {
    const { worst } = this.facts;
    byId("worst-section").hidden = !worst.length;
    if (!worst.length || !this.drawing) return;
    const { layers } = this.drawing;
    const cards = worst.map(({ row, why }) => {
      const canvas = element("canvas"), name = element("b", this.facts.names[row]);
      const act = () => { this.select(row, true); byId("view").scrollIntoView(); };
      this.measure(row);
      return { card: element("button", { type: "button", className: "card", onclick: act }, canvas, element("p", {}, name, why)), canvas, row };
    });
    for (const { canvas, row } of cards) this.picture(canvas, row);
    delete layers.mine;
    byId("worst").replaceChildren(...cards.map(({ card }) => card));
    this.redraw();
  }
}

function drawHistograms(facts) {
  const root = byId("histograms"), width = Math.max(root.clientWidth, 240);
  root.replaceChildren(...facts.histograms.map((one) => histogram(one, width)));
  if (!facts.histograms.length) root.append("There is nothing to be measured.");
}

async function openPage() {
  const data = await loadData(), viewer = (window.viewer = new Viewer(data));
  byId("map-legend").append(...viewer.standings());
  let width = 0;
  new ResizeObserver(([{ contentRect }]) => contentRect.width !== width && (width = contentRect.width, drawHistograms(data.facts))).observe(byId("histograms"));
  viewer.drawWorst();
  if (!viewer.follow() && data.facts.focus != null) viewer.select(data.facts.focus, false);
  document.body.dataset.state = "ready";
}

openPage().catch((error) => {
  byId("message").textContent = `The page cannot be shown: ${error.message}`;
  byId("message").hidden = false;
  console.error(error);
});
