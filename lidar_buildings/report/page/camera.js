// An eye that looks at a target, and the hand that moves it: matrices of column-major arrays, z up.

const FIELD = Math.PI / 4;
/** How far the eye stays off what is solid [m]. */
const CLEAR = 1.5;

class Camera {
  constructor() {
    this.target = [0, 0, 0];
    this.distance = 100;
    this.azimuth = -0.6;
    this.tilt = 0.75;
    /** Elevation of what is solid at a place, map frame; null where nothing is. */
    this.solidAt = () => null;
  }

  get state() {
    return { target: [...this.target], distance: this.distance, azimuth: this.azimuth, tilt: this.tilt };
  }

  /** Stand a share of the way between two states, the short way round. */
  between(from, to, share) {
    const mix = (a, b) => a + (b - a) * share, round = 2 * Math.PI;
    const turn = ((((to.azimuth - from.azimuth + Math.PI) % round) + round) % round) - Math.PI;
    this.target = from.target.map((value, axis) => mix(value, to.target[axis]));
    this.distance = Math.exp(mix(Math.log(from.distance), Math.log(to.distance)));
    this.azimuth = from.azimuth + turn * share;
    this.tilt = mix(from.tilt, to.tilt);
  }

  get eye() {
    const back = this.axes()[2];
    return this.target.map((value, axis) => value + back[axis] * this.distance);
  }

  /** Show a box [[x, y, z], [x, y, z]] in full, in the middle of a picture of this shape. */
  frame([low, high], aspect, room = 1.1) {
    this.target = low.map((value, axis) => (value + high[axis]) / 2);
    this.distance = Math.max(Math.hypot(...low.map((value, axis) => high[axis] - value)), 8);
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((axis) => ((k >> axis) & 1 ? high : low)[axis]));
    for (let round = 0; round < 6; round++) {
      const seen = corners.map((corner) => this.projected(corner, aspect));
      const [x, y] = [0, 1].map((axis) => seen.map((one) => one[axis]));
      const [wide, tall] = [x, y].map((one) => (Math.max(...one) - Math.min(...one)) / 2);
      const [right, up] = this.axes(), scale = Math.tan(FIELD / 2) * this.distance;
      const [dx, dy] = [x, y].map((one) => ((Math.max(...one) + Math.min(...one)) / 2) * scale);
      this.target = this.target.map((value, axis) => value + right[axis] * dx * aspect + up[axis] * dy);
      this.distance = Math.max(this.distance * Math.max(wide, tall) * room, 8);
    }
  }

  /** Return where in the picture a place is, -1 to 1. */
  projected(place, aspect) {
    const matrix = this.matrix(aspect), row = (k) => matrix[k] * place[0] + matrix[k + 4] * place[1] + matrix[k + 8] * place[2] + matrix[k + 12];
    const w = Math.max(row(3), 1e-3);
    return [row(0) / w, row(1) / w];
  }

  /** Turn by angles about a place, which stays where it is in the picture. */
  turn(along, upwards, pivot) {
    const seen = this.axes().map((axis) => dot(axis, minus(pivot, this.eye)));
    this.azimuth += along;
    this.tilt = clamped(this.tilt + upwards, 0.02, Math.PI / 2);
    const axes = this.axes(), reach = [seen[0], seen[1], seen[2] + this.distance];
    this.target = pivot.map((value, k) => value - axes.reduce((sum, axis, which) => sum + axis[k] * reach[which], 0));
  }

  /** Where the ray through a place of the picture (-1 to 1) meets an elevation; null if it is too far off. */
  onLevel([x, y], aspect, elevation) {
    const [right, up, back] = this.axes(), eye = this.eye, wide = Math.tan(FIELD / 2);
    const ray = back.map((value, axis) => right[axis] * x * wide * aspect + up[axis] * y * wide - value);
    const far = (elevation - eye[2]) / ray[2];
    return far > 0 && far < 20 * this.distance ? eye.map((value, axis) => value + ray[axis] * far) : null;
  }

  /** Move so that what lies at one place of the picture, at an elevation, comes to another. */
  move(from, to, aspect, elevation) {
    const [a, b] = [from, to].map((one) => this.onLevel(one, aspect, elevation));
    if (!a || !b) return;
    this.target[0] += a[0] - b[0];
    this.target[1] += a[1] - b[1];
  }

  /** Come nearer to a place (factor below 1), which stays where it is in the picture. */
  zoom(factor, place) {
    const distance = clamped(this.distance * factor, 4, 1e5), own = distance / this.distance;
    this.target = this.target.map((value, axis) => place[axis] + (value - place[axis]) * own);
    this.distance = distance;
  }

  /** How far the eye stands above what is solid near it [m]. */
  clearance() {
    const [x, y, z] = this.eye, around = [[0, 0], [CLEAR, 0], [-CLEAR, 0], [0, CLEAR], [0, -CLEAR]];
    return z - Math.max(...around.map(([dx, dy]) => this.solidAt(x + dx, y + dy) ?? -Infinity));
  }

  /** Rise until the eye is out of walls and terrain. */
  keepOut() {
    while (this.clearance() < CLEAR && this.tilt < Math.PI / 2) this.tilt = Math.min(this.tilt + 0.02, Math.PI / 2);
    for (let n = 0; n < 100 && this.clearance() < CLEAR; n++) this.distance *= 1.05;
  }

  /** Whether something solid stands between the eye and a place. */
  isHidden(place) {
    const eye = this.eye, along = minus(eye, place);
    return Array.from({ length: 60 }, (_, k) => (k + 3) / 63).some((share) => {
      const [x, y, z] = place.map((value, axis) => value + along[axis] * share);
      return (this.solidAt(x, y) ?? -Infinity) > z + 0.5;
    });
  }

  matrix(aspect) {
    const near = clamped(Math.min(this.distance, this.clearance()) / 8, 0.3, this.distance / 20 + 0.3), far = this.distance * 10 + 3000;
    return multiplied(perspective(aspect, near, far), this.view());
  }

  /** Return the directions to the right, up and back. */
  axes() {
    const [sin, cos, rise, level] = [Math.sin(this.azimuth), Math.cos(this.azimuth), Math.sin(this.tilt), Math.cos(this.tilt)];
    return [[cos, sin, 0], [-sin * rise, cos * rise, level], [sin * level, -cos * level, rise]];
  }

  view() {
    const eye = this.eye, [right, up, back] = this.axes();
    return new Float32Array([
      right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
      -dot(right, eye), -dot(up, eye), -dot(back, eye), 1,
    ]);
  }
}

function perspective(aspect, near, far) {
  const f = 1 / Math.tan(FIELD / 2);
  return new Float32Array([
    f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0,
  ]);
}

function multiplied(a, b) {
  const product = new Float32Array(16);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++)
      for (let k = 0; k < 4; k++) product[column * 4 + row] += a[k * 4 + row] * b[column * 4 + k];
  return product;
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const minus = (a, b) => a.map((value, axis) => value - b[axis]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const normalised = (a) => a.map((value) => value / (Math.hypot(...a) || 1));

/**
 * Mouse, pen, fingers and wheel on an element, told in its pixels:
 * down(at), drag(from, to, isMove), zoom(factor, at), twist(angle, at), tap(at), double(at), up().
 */
class Hand {
  constructor(target, acts) {
    this.fingers = new Map();
    this.acts = acts;
    const listen = (name, act) => target.addEventListener(name, act, { passive: false });
    listen("pointerdown", (event) => this.down(event, target));
    listen("pointermove", (event) => this.moved(event));
    listen("pointerup", (event) => this.up(event));
    listen("pointercancel", (event) => this.up(event));
    listen("contextmenu", (event) => event.preventDefault());
    listen("dblclick", (event) => acts.double?.(Hand.at(event)));
    listen("wheel", (event) => {
      if (acts.wantsWheel && !acts.wantsWheel(event)) return;
      event.preventDefault();
      const steps = event.deltaY * (event.deltaMode ? 16 : 1) * (event.ctrlKey ? 0.01 : 0.0015);
      acts.zoom(Math.exp(clamped(steps, -0.5, 0.5)), Hand.at(event));
    });
  }

  static at = (event) => [event.offsetX, event.offsetY];

  down(event, target) {
    target.setPointerCapture(event.pointerId);
    this.isTap = this.fingers.size === 0 && event.button === 0;
    this.fingers.set(event.pointerId, Hand.at(event));
    if (this.fingers.size === 1) this.start = Hand.at(event);
    this.acts.down?.(this.middle());
  }

  middle() {
    const all = [...this.fingers.values()];
    return [0, 1].map((axis) => all.reduce((sum, one) => sum + one[axis], 0) / all.length);
  }

  /** Length and angle of the line between the first two fingers. */
  span() {
    const [a, b] = [...this.fingers.values()];
    return [Math.hypot(b[0] - a[0], b[1] - a[1]), Math.atan2(b[1] - a[1], b[0] - a[0])];
  }

  moved(event) {
    if (!this.fingers.has(event.pointerId)) return;
    const now = Hand.at(event), isPinch = this.fingers.size > 1;
    if (this.isTap && Math.hypot(now[0] - this.start[0], now[1] - this.start[1]) < 5) return;
    this.isTap = false;
    const before = this.middle(), span = isPinch ? this.span() : null;
    this.fingers.set(event.pointerId, now);
    const middle = this.middle();
    this.acts.drag(before, middle, isPinch || event.shiftKey || event.ctrlKey || (event.buttons & 6) > 0);
    if (!isPinch) return;
    const [length, angle] = this.span();
    this.acts.zoom(span[0] / Math.max(length, 1), middle);
    const twist = angle - span[1];
    this.acts.twist?.(Math.abs(twist) > Math.PI ? 0 : twist, middle);
  }

  up(event) {
    if (!this.fingers.delete(event.pointerId)) return;
    if (this.isTap && event.type === "pointerup") this.acts.tap(Hand.at(event));
    this.isTap = false;
    if (this.fingers.size) this.acts.down?.(this.middle());
    else this.acts.up?.();
  }
}
