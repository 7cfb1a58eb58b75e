// An eye that circles round a target: matrices of column-major arrays, z up.

class Camera {
  constructor() {
    this.target = [0, 0, 0];
    this.distance = 100;
    this.azimuth = -0.6;
    this.tilt = 0.75;
  }

  get eye() {
    const level = Math.cos(this.tilt) * this.distance;
    return [
      this.target[0] + Math.sin(this.azimuth) * level,
      this.target[1] - Math.cos(this.azimuth) * level,
      this.target[2] + Math.sin(this.tilt) * this.distance,
    ];
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

  turn(dx, dy) {
    this.azimuth -= dx * 0.006;
    this.tilt = Math.min(Math.max(this.tilt + dy * 0.006, -0.1), Math.PI / 2);
  }

  /** Move the target along the ground by pixels of a canvas so high. */
  move(dx, dy, height) {
    const scale = (2 * Math.tan(FIELD / 2) * this.distance) / height;
    const [sin, cos] = [Math.sin(this.azimuth), Math.cos(this.azimuth)];
    const along = (dy * scale) / Math.max(Math.sin(this.tilt), 0.3);
    this.target[0] += -dx * scale * cos - along * sin;
    this.target[1] += -dx * scale * sin + along * cos;
  }

  approach(steps) {
    this.distance = Math.min(Math.max(this.distance * Math.exp(steps), 1), 1e5);
  }

  matrix(aspect) {
    const near = Math.max(this.distance / 200, 0.1), far = this.distance * 20 + 2000;
    return multiplied(perspective(aspect, near, far), this.view());
  }

  /** Return the directions to the right, up and back. */
  axes() {
    // straight down there is no horizon: what is up in the picture follows from the azimuth
    const right = [Math.cos(this.azimuth), Math.sin(this.azimuth), 0];
    const back = normalised(this.eye.map((value, axis) => value - this.target[axis]));
    return [right, cross(back, right), back];
  }

  view() {
    const eye = this.eye, [right, up, back] = this.axes();
    return new Float32Array([
      right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
      -dot(right, eye), -dot(up, eye), -dot(back, eye), 1,
    ]);
  }
}

const FIELD = Math.PI / 4;

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
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const normalised = (a) => a.map((value) => value / (Math.hypot(...a) || 1));
