// The object in WebGL 2: corners with texture coordinates, and per texture a colour and a material.
const VERTEX = `#version 300 es
in vec3 place; in vec2 uv; in vec3 normal;
uniform mat4 matrix;
out vec2 at; out vec3 facing;
void main() { at = uv; facing = normal; gl_Position = matrix * vec4(place, 1.0); }`;

const FRAGMENT = `#version 300 es
precision highp float; precision highp usampler2D;
in vec2 at; in vec3 facing;
uniform sampler2D colors, palette; uniform usampler2D labels;
uniform bool byLabel, shaded, some; uniform vec3 back;
out vec4 shown;
const uint NONE = 65535u;
uint label(ivec2 p) { return texelFetch(labels, clamp(p, ivec2(0), textureSize(labels, 0) - 1), 0).r; }
void main() {
  ivec2 p = ivec2(at * vec2(textureSize(labels, 0)));
  uint own = label(p);
  vec4 mine = own == NONE ? vec4(0.227, 0.239, 0.259, 0.0) : texelFetch(palette, ivec2(int(own) % 1024, int(own) / 1024), 0);
  vec3 color = byLabel ? mine.rgb : texture(colors, at).rgb;
  if (some && mine.a < 0.5) color = byLabel ? mix(vec3(dot(color, vec3(0.2126, 0.7152, 0.0722))), color, 0.25) * 0.55 : 0.7 * color;
  if (shaded) {
    float n = abs(dot(normalize(facing), back));
    color *= byLabel ? 0.45 + 0.55 * n : 0.7 + 0.3 * n;
  }
  shown = vec4(color, 1.0);
}`;

export class Painted {
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: false });
    if (!gl) throw new Error("this browser has no WebGL 2: the object cannot be shown");
    this.gl = gl;
    this.program = this.#link();
    this.parts = [];
    this.palette = this.#texture(gl.NEAREST);
    this.some = false;
    gl.enable(gl.DEPTH_TEST);
    gl.clearColor(0.09, 0.098, 0.11, 1);
  }

  // geometry: the server's bytes; pixels: per texture, the texel of each pixel
  load(textures, geometry, pixels) {
    const gl = this.gl;
    let start = 0;
    const take = (Type, count) => {
      const values = new Type(geometry, start, count);
      start += values.byteLength;
      return values;
    };
    this.parts = textures.map((texture, k) => {
      const corners = 3 * texture.faces;
      const array = gl.createVertexArray();
      gl.bindVertexArray(array);
      const attribute = (name, values, size, type, normalised) => {
        gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
        gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
        const place = gl.getAttribLocation(this.program, name);
        gl.enableVertexAttribArray(place);
        gl.vertexAttribPointer(place, size, type, normalised, type === gl.BYTE ? 4 : 0, 0);
      };
      attribute("place", take(Float32Array, 3 * corners), 3, gl.FLOAT, false);
      attribute("uv", take(Float32Array, 2 * corners), 2, gl.FLOAT, false);
      attribute("normal", take(Int8Array, 4 * corners), 3, gl.BYTE, true);
      const most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
      if (Math.max(texture.width, texture.height) > most)
        throw new Error(`textures of ${texture.width} pixels: this browser shows up to ${most}`);
      return { ...texture, array, corners, pixels: pixels[k], colors: this.#texture(gl.LINEAR), labels: this.#texture(gl.NEAREST) };
    });
  }

  // colors: (T, 3) bytes
  paint(colors) {
    const gl = this.gl;
    for (const part of this.parts) {
      const image = new Uint8Array(4 * part.pixels.length);
      part.pixels.forEach((texel, p) => {
        if (texel < 0) return;
        image[4 * p] = colors[3 * texel];
        image[4 * p + 1] = colors[3 * texel + 1];
        image[4 * p + 2] = colors[3 * texel + 2];
      });
      gl.bindTexture(gl.TEXTURE_2D, part.colors);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, part.width, part.height, 0, gl.RGBA, gl.UNSIGNED_BYTE, image);
    }
  }

  // labels: (T,) uint16
  label(labels) {
    const gl = this.gl;
    for (const part of this.parts) {
      const image = new Uint16Array(part.pixels.length);
      part.pixels.forEach((texel, p) => { image[p] = texel < 0 ? 65535 : labels[texel]; });
      gl.bindTexture(gl.TEXTURE_2D, part.labels);
      gl.pixelStorei(gl.UNPACK_ALIGNMENT, 2);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.R16UI, part.width, part.height, 0, gl.RED_INTEGER, gl.UNSIGNED_SHORT, image);
      gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
    }
  }

  // The clusters' colours, and which are selected
  color(clusters, selected) {
    const gl = this.gl, rows = Math.ceil((1 + Math.max(0, ...clusters.map((c) => c.id))) / 1024);
    const image = new Uint8Array(4 * 1024 * rows);
    for (const { id, color } of clusters) image.set([...color, selected.has(id) ? 255 : 0], 4 * id);
    this.some = selected.size > 0;
    gl.bindTexture(gl.TEXTURE_2D, this.palette);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 1024, rows, 0, gl.RGBA, gl.UNSIGNED_BYTE, image);
  }

  draw(camera, byLabel, shaded) {
    const gl = this.gl, place = (name) => gl.getUniformLocation(this.program, name);
    gl.viewport(0, 0, gl.canvas.width, gl.canvas.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(place("matrix"), false, camera.matrix());
    gl.uniform3fv(place("back"), camera.axes[2]);
    gl.uniform1i(place("byLabel"), byLabel);
    gl.uniform1i(place("shaded"), shaded);
    gl.uniform1i(place("some"), this.some);
    ["colors", "labels", "palette"].forEach((name, unit) => gl.uniform1i(place(name), unit));
    for (const part of this.parts) {
      [part.colors, part.labels, this.palette].forEach((texture, unit) => {
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(gl.TEXTURE_2D, texture);
      });
      gl.bindVertexArray(part.array);
      gl.drawArrays(gl.TRIANGLES, 0, part.corners);
    }
    gl.activeTexture(gl.TEXTURE0);
  }

  #texture(filter) {
    const gl = this.gl, texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, filter);
    for (const axis of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, axis, gl.CLAMP_TO_EDGE);
    return texture;
  }

  #link() {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return program;
  }
}
