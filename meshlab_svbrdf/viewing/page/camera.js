// Where one looks from: a turn without poles, a distance, a shift. Lengths are the object's radii.
const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
const TAN = Math.tan((35 / 2) * Math.PI / 180);

export class Camera {
  constructor() {
    this.axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]; // right, up, back
    this.target = [0, 0, 0];
    this.distance = 1.08 / Math.sin((35 / 2) * Math.PI / 180);
    this.size = [1, 1];
    this.turn(0.5, 0.25);
  }

  get eye() { return add(this.target, this.axes[2], this.distance); }

  // Radians about the camera's own up and right
  turn(across, down) {
    const spin = (a, b, angle) => {
      const [c, s] = [Math.cos(angle), Math.sin(angle)];
      const [u, v] = [this.axes[a], this.axes[b]];
      this.axes[a] = u.map((x, i) => c * x - s * v[i]);
      this.axes[b] = u.map((x, i) => s * x + c * v[i]);
    };
    spin(0, 2, -across);
    spin(1, 2, down);
    this.#straighten();
  }

  zoom(factor) { this.distance = Math.min(Math.max(this.distance * factor, 0.05), 40); }

  shift(dx, dy) {
    const step = 2 * TAN * this.distance / this.size[1];
    this.target = add(add(this.target, this.axes[0], -dx * step), this.axes[1], dy * step);
  }

  // From where and whither a pixel looks, in radii about the centre
  ray(x, y) {
    const [w, h] = this.size;
    const u = (2 * x / w - 1) * TAN * w / h, v = (1 - 2 * y / h) * TAN;
    const [right, up, back] = this.axes;
    return [this.eye, right.map((r, i) => u * r + v * up[i] - back[i])];
  }

  // The pixel of a point, or null behind the camera
  project(point) {
    const from = add(point, this.eye, -1);
    const [x, y, z] = this.axes.map((axis) => axis.reduce((s, a, i) => s + a * from[i], 0));
    if (z >= 0) return null;
    const [w, h] = this.size;
    return [w / 2 * (1 + x / (-z * TAN * w / h)), h / 2 * (1 - y / (-z * TAN))];
  }

  // Column-major, for WebGL
  matrix() {
    const [right, up, back] = this.axes, eye = this.eye;
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const near = Math.max(this.distance - 4, this.distance / 200), far = this.distance + 6;
    const f = 1 / TAN, a = f * this.size[1] / this.size[0];
    const p = (near + far) / (near - far), q = 2 * near * far / (near - far);
    const rows = [
      [...right.map((x) => a * x), -a * dot(right, eye)],
      [...up.map((x) => f * x), -f * dot(up, eye)],
      [...back.map((x) => p * x), -p * dot(back, eye) + q],
      [...back.map((x) => -x), dot(back, eye)],
    ];
    return new Float32Array([0, 1, 2, 3].flatMap((c) => rows.map((row) => row[c])));
  }

  #straighten() {
    const unit = (v) => { const n = Math.hypot(...v); return v.map((x) => x / n); };
    const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    const back = unit(this.axes[2]);
    const right = unit(cross(this.axes[1], back));
    this.axes = [right, cross(back, right), back];
  }
}
