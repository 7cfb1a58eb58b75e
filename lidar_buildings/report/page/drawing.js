// WebGL 2: surfaces in light and shadow, lines and points in one buffer layout, the sky; what stands under a pixel.

const VERTEX = `#version 300 es
precision highp float; precision highp int;
in vec3 place; in vec4 colour; in uint owner;
uniform mat4 matrix; uniform float size; uniform bool is_point;
out vec3 v_place; out vec4 v_colour; flat out uint v_owner;
void main() {
  v_place = place; v_colour = colour; v_owner = owner;
  gl_Position = matrix * vec4(place, 1.0);
  float wide = size / gl_Position.w;
  gl_PointSize = clamp(wide, 1.5, 14.0);
  // what would be smaller than a pixel is drawn the more seldom, so that from afar roofs show through
  uint hash = uint(gl_VertexID) * 2654435761u;
  hash = (hash ^ (hash >> 15)) * 2246822519u;
  float chance = float((hash ^ (hash >> 13)) & 0xffffu) / 65536.0;
  if (is_point && chance > wide * wide * 0.25) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
}`;
// what the sky and the sun give to a face, at its corners; the fragments find out how much of both arrives
const SURFACE_VERTEX = `#version 300 es
precision highp float; precision highp int;
in vec3 place; in vec4 colour; in uint owner; in vec4 normal;
uniform mat4 matrix, sun_matrix; uniform vec4 field; uniform vec3 sun; uniform float cell, pale; uniform uint selected;
flat out vec3 from_sky, from_sun; out vec3 seen, at;
void main() {
  gl_Position = matrix * vec4(place, 1.0);
  seen = (sun_matrix * vec4(place + normal.xyz * 0.3, 1.0)).xyz * 0.5 + vec3(0.5, 0.5, 0.499);
  at = vec3((place.xy + normal.xy * 2.0 * cell - field.xy) * field.zw, normal.w);
  vec3 own = mix(colour.rgb, vec3(0.9), pale);
  if (selected > 0u && owner == selected) own = mix(own, vec3(0.1, 0.52, 1.0), 0.6);
  from_sky = own * mix(vec3(0.50, 0.47, 0.44), vec3(0.62, 0.66, 0.74), 0.5 + 0.5 * normal.z);
  from_sun = own * vec3(0.56, 0.52, 0.45) * max(dot(normal.xyz, sun), 0.0);
}`;
const SURFACE = `#version 300 es
precision highp float; precision highp sampler2DShadow;
flat in vec3 from_sky, from_sun; in vec3 seen, at; uniform sampler2DShadow shadow; uniform sampler2D cover; out vec4 result;
void main() {
  result = vec4(from_sky * mix(texture(cover, at.xy).a, 1.0, at.z) + from_sun * texture(shadow, seen), 1.0);
}`;
const TERRAIN = `#version 300 es
precision highp float; precision highp sampler2DShadow;
flat in vec3 from_sky, from_sun; in vec3 seen, at; uniform sampler2DShadow shadow; uniform sampler2D cover; out vec4 result;
void main() {
  vec4 under = texture(cover, at.xy);
  result = vec4(under.rgb * (from_sky * under.a + from_sun * texture(shadow, seen)), 1.0);
}`;
const FLAT = `#version 300 es
precision highp float; precision highp int;
in vec3 v_place; in vec4 v_colour; flat in uint v_owner; uniform float strength; out vec4 result;
void main() { result = vec4(v_colour.rgb, strength); }`;
const PICK = `#version 300 es
precision highp float; precision highp int;
in vec3 v_place; in vec4 v_colour; flat in uint v_owner; out uvec4 result;
void main() { result = uvec4(v_owner, floatBitsToUint(v_place)); }`;
const DEPTH = `#version 300 es
precision highp float; void main() {}`;
// the colours of the sky at the corners of a grid of 6 × 24 fields
const SKY_VERTEX = `#version 300 es
precision highp float; uniform vec3 right, up, back, zenith, horizon, below; out vec3 colour;
void main() {
  int corner = gl_VertexID % 6, field = gl_VertexID / 6;
  vec2 at = vec2(field % 6, field / 6) + vec2(corner == 1 || corner == 2 || corner == 4, corner == 2 || corner == 4 || corner == 5);
  at = at / vec2(3.0, 12.0) - 1.0;
  float rise = normalize(right * at.x + up * at.y - back).z;
  colour = rise > 0.0 ? mix(horizon, zenith, pow(min(rise * 2.0, 1.0), 0.6)) : mix(horizon, below, sqrt(-rise));
  gl_Position = vec4(at, 1.0, 1.0);
}`;
const SKY = `#version 300 es
precision highp float; in vec3 colour; out vec4 result;
void main() { result = vec4(colour, 1.0); }`;
/** Zenith, horizon and what is below it, by day and in dark pages. */
const SKIES = {
  light: [[0.42, 0.63, 0.87], [0.88, 0.92, 0.95], [0.72, 0.78, 0.83]],
  dark: [[0.03, 0.06, 0.12], [0.17, 0.22, 0.29], [0.07, 0.09, 0.12]],
};
const SUN = normalised([-0.62, -0.30, 0.80]);
const SHADOW_SIZE = Math.min(screen.width, screen.height) < 700 ? 2048 : 4096;
/** Bytes of a vertex: three float32, a colour, an owner (a building's row and one), a normal in bytes. */
const STRIDE = 24;

class Drawing {
  constructor(canvas) {
    this.canvas = canvas;
    const gl = (this.gl = canvas.getContext("webgl2", { antialias: false, alpha: false }));
    if (!gl) throw new Error("This browser has no WebGL 2: the 3D view is left out.");
    this.programs = {
      surface: this.linked(SURFACE_VERTEX, SURFACE), terrain: this.linked(SURFACE_VERTEX, TERRAIN), flat: this.linked(VERTEX, FLAT), pick: this.linked(VERTEX, PICK),
      depth: this.linked(VERTEX, DEPTH), sky: this.linked(SKY_VERTEX, SKY),
    };
    this.layers = {};
    this.samples = Math.min(4, gl.getParameter(gl.MAX_SAMPLES));
    this.cover = this.texture(gl.LINEAR);
    this.shadow = this.texture(gl.LINEAR);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOW_SIZE, SHADOW_SIZE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
    this.shadowTarget = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowTarget);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.shadow, 0);
    this.pickTarget = this.target(1, 1, gl.RGBA32UI, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  linked(...sources) {
    const gl = this.gl, program = gl.createProgram();
    sources.forEach((source, k) => {
      const shader = gl.createShader(k ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    });
    ["place", "colour", "owner", "normal"].forEach((name, place) => gl.bindAttribLocation(program, place, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const uniform = {};
    for (let k = 0; k < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); k++) {
      const { name } = gl.getActiveUniform(program, k);
      uniform[name] = gl.getUniformLocation(program, name);
    }
    return { program, uniform };
  }

  texture(filter) {
    const gl = this.gl, texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, filter], [gl.TEXTURE_MAG_FILTER, filter], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]])
      gl.texParameteri(gl.TEXTURE_2D, name, value);
    return texture;
  }

  /** A framebuffer with buffers for colours and depths. */
  target(width, height, format, samples) {
    const gl = this.gl, framebuffer = gl.createFramebuffer();
    const buffers = [[gl.COLOR_ATTACHMENT0, format], [gl.DEPTH_ATTACHMENT, gl.DEPTH_COMPONENT24]].map(([where, kind]) => {
      const buffer = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.renderbufferStorageMultisample(gl.RENDERBUFFER, samples, kind, width, height);
      gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, where, gl.RENDERBUFFER, buffer);
      return buffer;
    });
    return { framebuffer, buffers };
  }

  /** Take the terrain's colours and openness. */
  setField({ columns, rows, cover, west, north, cell }) {
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, this.cover);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, columns, rows, 0, gl.RGBA, gl.UNSIGNED_BYTE, cover);
    this.field = [west, north, 1 / (columns * cell), -1 / (rows * cell)];
    this.cell = cell;
  }

  /** Put a layer's vertices on the card; kind is surface, terrain, lines or points. */
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

  /** Draw the models' depths as the sun sees them; once, as neither of them moves. */
  castShadows([low, high]) {
    const gl = this.gl, axes = [normalised(cross([0, 0, 1], SUN))];
    axes.push(cross(SUN, axes[0]), SUN.map((value) => -value));
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((axis) => ((k >> axis) & 1 ? high : low)[axis]));
    const matrix = (this.sunMatrix = new Float32Array(16));
    axes.forEach((axis, row) => {
      const along = corners.map((corner) => dot(axis, corner)), [from, to] = [Math.min(...along) - 1, Math.max(...along) + 1];
      axis.forEach((value, k) => (matrix[4 * k + row] = (2 * value) / (to - from)));
      matrix[12 + row] = -(from + to) / (to - from);
    });
    matrix[15] = 1;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowTarget);
    gl.viewport(0, 0, SHADOW_SIZE, SHADOW_SIZE);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    if (this.layers.models.is_shown) this.drawLayers(this.programs.depth, matrix, ["models"], SHADOW_SIZE, 1);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** Draw all layers that are shown: at rest with smooth edges, in haste a coarser terrain, and of points every so many-th. */
  draw(camera, { selected = 0, every = 1, isSmooth = true, pale = 0 } = {}) {
    const gl = this.gl, { width, height } = this.canvas;
    if (isSmooth && this.samples > 1) this.useSmooth(width, height);
    gl.viewport(0, 0, width, height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const matrix = camera.matrix(width / height), others = every > 1 ? "still" : "hasty";
    const shown = Object.keys(this.layers).filter((name) => this.layers[name].is_shown && this.layers[name].when !== others);
    const of = (...kinds) => shown.filter((name) => kinds.includes(this.layers[name].kind));
    [this.shadow, this.cover].forEach((texture, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
    });
    for (const kind of ["surface", "terrain"]) {
      const { program, uniform } = this.programs[kind];
      gl.useProgram(program);
      gl.uniform3fv(uniform.sun, SUN);
      gl.uniformMatrix4fv(uniform.sun_matrix, false, this.sunMatrix);
      gl.uniform4fv(uniform.field, this.field);
      gl.uniform1f(uniform.cell, this.cell);
      gl.uniform1f(uniform.pale, kind === "surface" ? pale : 0);
      gl.uniform1ui(uniform.selected, selected);
      if (kind === "surface") gl.enable(gl.CULL_FACE); // solids are closed
      ["shadow", "cover"].forEach((name, unit) => gl.uniform1i(uniform[name], unit));
      this.drawLayers(this.programs[kind], matrix, of(kind), height, 1);
      gl.disable(gl.CULL_FACE);
    }
    this.drawSky(camera, width / height);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    this.drawLayers(this.programs.flat, matrix, of("lines", "points"), height, every);
    gl.disable(gl.BLEND);
    if (isSmooth && this.samples > 1) this.showSmooth(width, height);
  }

  useSmooth(width, height) {
    const gl = this.gl;
    if (this.smooth?.width !== width || this.smooth?.height !== height) {
      for (const old of this.smooth?.targets ?? []) {
        gl.deleteFramebuffer(old.framebuffer);
        old.buffers.forEach((buffer) => gl.deleteRenderbuffer(buffer));
      }
      this.smooth = { width, height, targets: [this.samples, 0].map((samples) => this.target(width, height, gl.RGBA8, samples)) };
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.smooth.targets[0].framebuffer);
  }

  /** Average the samples, and only then change to the canvas' format. */
  showSmooth(width, height) {
    const gl = this.gl, [many, one] = this.smooth.targets.map((target) => target.framebuffer);
    for (const [from, to] of [[many, one], [one, null]]) {
      gl.bindFramebuffer(gl.READ_FRAMEBUFFER, from);
      gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, to);
      gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** Fill what nothing covers. */
  drawSky(camera, aspect) {
    const gl = this.gl, { program, uniform } = this.programs.sky, [right, up, back] = camera.axes(), wide = Math.tan(FIELD / 2);
    gl.useProgram(program);
    gl.uniform3fv(uniform.right, right.map((value) => value * wide * aspect));
    gl.uniform3fv(uniform.up, up.map((value) => value * wide));
    gl.uniform3fv(uniform.back, back);
    SKIES[isDark() ? "dark" : "light"].forEach((colour, k) => gl.uniform3fv(uniform[["zenith", "horizon", "below"][k]], colour));
    gl.depthFunc(gl.LEQUAL);
    gl.drawArrays(gl.TRIANGLES, 0, 6 * 6 * 24);
    gl.depthFunc(gl.LESS);
  }

  drawLayers({ program, uniform }, matrix, names, height, every) {
    const gl = this.gl;
    gl.useProgram(program);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 2);
    gl.uniformMatrix4fv(uniform.matrix, false, matrix);
    for (const layer of names.map((name) => this.layers[name])) {
      const step = layer.kind === "points" ? every : 1;
      if (!layer.count) continue;
      gl.uniform1i(uniform.is_point ?? null, layer.kind === "points" ? 1 : 0);
      gl.uniform1f(uniform.strength ?? null, layer.strength ?? 1);
      gl.uniform1f(uniform.size ?? null, ((layer.size ?? 1) * Math.sqrt(step) * height) / (2 * Math.tan(FIELD / 2)));
      gl.bindBuffer(gl.ARRAY_BUFFER, layer.buffer);
      for (let place = 0; place < 4; place++) gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(0, 3, gl.FLOAT, false, STRIDE * step, 0);
      gl.vertexAttribPointer(1, 4, gl.UNSIGNED_BYTE, true, STRIDE * step, 12);
      gl.vertexAttribIPointer(2, 1, gl.UNSIGNED_INT, STRIDE * step, 16);
      gl.vertexAttribPointer(3, 4, gl.BYTE, true, STRIDE * step, 20);
      if (layer.n_rows) {
        gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, layer.index);
        gl.drawElements(gl.TRIANGLES, layer.n_rows, gl.UNSIGNED_INT, 0);
      } else {
        const mode = { surface: gl.TRIANGLES, terrain: gl.TRIANGLES, lines: gl.LINES, points: gl.POINTS }[layer.kind];
        gl.drawArrays(mode, 0, Math.floor(layer.count / step));
      }
    }
  }

  /** Return {owner, place} of the surface at a place of the canvas [its pixels from the upper left]; null of the sky. */
  pick(camera, x, y) {
    const gl = this.gl, { width, height } = this.canvas, found = new Uint32Array(4);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.pickTarget.framebuffer);
    gl.viewport(-Math.round(x), -(height - 1 - Math.round(y)), width, height);
    gl.clearBufferuiv(gl.COLOR, 0, new Uint32Array(4));
    gl.clear(gl.DEPTH_BUFFER_BIT);
    const names = Object.keys(this.layers).filter((name) => this.layers[name].is_shown && this.layers[name].kind !== "lines" && this.layers[name].when !== "hasty");
    this.drawLayers(this.programs.pick, camera.matrix(width / height), names, height, 1);
    gl.readPixels(0, 0, 1, 1, gl.RGBA_INTEGER, gl.UNSIGNED_INT, found);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    const place = [...new Float32Array(found.buffer, 4, 3)];
    return found.some(Boolean) ? { owner: found[0], place } : null;
  }
}

/** Vertices of a layer: places, colours, owners and normals side by side. */
class Vertices {
  constructor(count) {
    this.count = count;
    this.buffer = new ArrayBuffer(count * STRIDE);
    this.floats = new Float32Array(this.buffer);
    this.words = new Uint32Array(this.buffer);
  }

  /** A normal in one word, for `set`, and how far up its wall a vertex is, from 0 to 1. */
  static packed(normal, risen) {
    return [...normal, risen].reduce((word, value, k) => word | ((Math.round(127 * value) & 255) << (8 * k)), 0);
  }

  set(row, x, y, z, colour, owner = 0, normal = 0x7f0000) {
    const at = row * 6;
    this.floats[at] = x;
    this.floats[at + 1] = y;
    this.floats[at + 2] = z;
    this.words[at + 3] = colour;
    this.words[at + 4] = owner;
    this.words[at + 5] = normal;
  }
}
