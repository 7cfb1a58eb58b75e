// WebGL 2: surfaces, lines and points in one buffer layout; what stands under a pixel.

const VERTEX = `#version 300 es
precision highp float; precision highp int;
in vec3 place; in vec4 colour; in uint owner;
uniform mat4 matrix; uniform float size; uniform float lift; uniform bool is_point;
out vec3 v_place; out vec4 v_colour; flat out uint v_owner;
void main() {
  v_place = place; v_colour = colour; v_owner = owner;
  gl_Position = matrix * vec4(place, 1.0);
  gl_Position.z -= lift * gl_Position.w;
  float wide = size / gl_Position.w;
  gl_PointSize = clamp(wide, 1.5, 14.0);
  // what would be smaller than a pixel is drawn the more seldom, so that from afar roofs show through
  uint hash = uint(gl_VertexID) * 2654435761u;
  hash = (hash ^ (hash >> 15)) * 2246822519u;
  float chance = float((hash ^ (hash >> 13)) & 0xffffu) / 65536.0;
  if (is_point && chance > wide * wide * 0.25) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision highp float; precision highp int;
in vec3 v_place; in vec4 v_colour; flat in uint v_owner;
uniform bool is_surface; uniform bool is_pick; uniform uint selected; uniform vec3 eye;
out vec4 result;
void main() {
  if (is_pick) {
    result = vec4(float(v_owner & 255u), float((v_owner >> 8) & 255u), float(v_owner >> 16), 255.0) / 255.0;
    return;
  }
  vec3 colour = v_colour.rgb;
  if (is_surface) {
    vec3 normal = normalize(cross(dFdx(v_place), dFdy(v_place)));
    if (dot(normal, eye - v_place) < 0.0) normal = -normal;
    float sun = max(dot(normal, normalize(vec3(-0.45, -0.35, 0.82))), 0.0);
    float sky = 0.5 + 0.5 * normal.z;
    colour *= 0.38 + 0.50 * sun + 0.20 * sky;
    if (selected > 0u && v_owner == selected) colour = mix(colour, vec3(1.0, 0.83, 0.2), 0.38);
  }
  result = vec4(colour, 1.0);
}`;
const BACKGROUND = [0.914, 0.933, 0.953];
/** Bytes of a vertex: three float32, a colour, an owner (a building's row and one). */
const STRIDE = 20;

class Drawing {
  constructor(canvas) {
    this.canvas = canvas;
    const gl = (this.gl = canvas.getContext("webgl2", { antialias: true, alpha: false }));
    if (!gl) throw new Error("This browser has no WebGL 2: the 3D view is left out.");
    this.program = this.linked();
    this.uniform = {};
    for (const name of ["matrix", "size", "lift", "is_surface", "is_point", "is_pick", "selected", "eye"])
      this.uniform[name] = gl.getUniformLocation(this.program, name);
    this.layers = {};
  }

  linked() {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    ["place", "colour", "owner"].forEach((name, place) => gl.bindAttribLocation(program, place, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return program;
  }

  /** Put a layer's vertices on the card; kind is surface, lines or points. */
  upload(name, kind, vertices, more = {}) {
    const gl = this.gl, layer = (this.layers[name] ??= { buffer: gl.createBuffer(), is_shown: true });
    Object.assign(layer, { kind, count: vertices.count, ...more });
    gl.bindBuffer(gl.ARRAY_BUFFER, layer.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, vertices.buffer, gl.STATIC_DRAW);
    if (vertices.rows) {
      layer.index ??= gl.createBuffer();
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, layer.index);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, vertices.rows, gl.STATIC_DRAW);
      layer.n_rows = vertices.rows.length;
    }
  }

  /** Draw all layers that are shown; in haste of points every so many-th, and a coarser terrain. */
  draw(camera, selected, every = 1) {
    const gl = this.gl;
    this.begin(camera, BACKGROUND);
    gl.uniform1ui(this.uniform.selected, selected);
    const others = every > 1 ? "still" : "hasty";
    for (const layer of Object.values(this.layers)) if (layer.is_shown && layer.when !== others) this.drawLayer(layer, every);
  }

  begin(camera, colour) {
    const gl = this.gl, { width, height } = this.canvas;
    gl.viewport(0, 0, width, height);
    gl.clearColor(...colour, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(this.uniform.matrix, false, camera.matrix(width / height));
    gl.uniform3fv(this.uniform.eye, camera.eye);
    gl.uniform1i(this.uniform.is_pick, 0);
    this.scale = height / (2 * Math.tan(FIELD / 2));
  }

  drawLayer(layer, every) {
    const gl = this.gl, step = layer.kind === "points" ? every : 1;
    if (!layer.count) return;
    gl.uniform1i(this.uniform.is_surface, layer.kind === "surface" ? 1 : 0);
    gl.uniform1i(this.uniform.is_point, layer.kind === "points" ? 1 : 0);
    gl.uniform1f(this.uniform.lift, layer.lift ?? 0);
    gl.uniform1f(this.uniform.size, (layer.size ?? 1) * Math.sqrt(step) * this.scale);
    gl.bindBuffer(gl.ARRAY_BUFFER, layer.buffer);
    for (let place = 0; place < 3; place++) gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, STRIDE * step, 0);
    gl.vertexAttribPointer(1, 4, gl.UNSIGNED_BYTE, true, STRIDE * step, 12);
    gl.vertexAttribIPointer(2, 1, gl.UNSIGNED_INT, STRIDE * step, 16);
    if (layer.n_rows) {
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, layer.index);
      gl.drawElements(gl.TRIANGLES, layer.n_rows, gl.UNSIGNED_INT, 0);
    } else {
      const mode = { surface: gl.TRIANGLES, lines: gl.LINES, points: gl.POINTS }[layer.kind];
      gl.drawArrays(mode, 0, Math.floor(layer.count / step));
    }
  }

  /** Return the owner at a place of the canvas [pixels from its upper left], 0 for none. */
  owner(camera, x, y) {
    const gl = this.gl, pixel = new Uint8Array(4);
    const target = gl.createFramebuffer(), { width, height } = this.canvas;
    const buffers = [[gl.COLOR_ATTACHMENT0, gl.RGBA8], [gl.DEPTH_ATTACHMENT, gl.DEPTH_COMPONENT24]].map(([where, format]) => {
      const buffer = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.renderbufferStorage(gl.RENDERBUFFER, format, width, height);
      gl.bindFramebuffer(gl.FRAMEBUFFER, target);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, where, gl.RENDERBUFFER, buffer);
      return buffer;
    });
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(x - 1, height - y - 2, 3, 3);
    this.begin(camera, [0, 0, 0]);
    gl.uniform1i(this.uniform.is_pick, 1);
    for (const layer of Object.values(this.layers)) if (layer.is_shown && layer.kind !== "lines" && layer.when !== "hasty") this.drawLayer(layer, 1);
    gl.readPixels(x, height - y - 1, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    gl.disable(gl.SCISSOR_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(target);
    buffers.forEach((buffer) => gl.deleteRenderbuffer(buffer));
    return pixel[0] + 256 * pixel[1] + 65536 * pixel[2];
  }
}

/** Vertices of a layer: places, colours and owners side by side. */
class Vertices {
  constructor(count) {
    this.count = count;
    this.buffer = new ArrayBuffer(count * STRIDE);
    this.floats = new Float32Array(this.buffer);
    this.words = new Uint32Array(this.buffer);
  }

  set(row, x, y, z, colour, owner = 0) {
    const at = row * 5;
    this.floats[at] = x;
    this.floats[at + 1] = y;
    this.floats[at + 2] = z;
    this.words[at + 3] = colour;
    this.words[at + 4] = owner;
  }
}
