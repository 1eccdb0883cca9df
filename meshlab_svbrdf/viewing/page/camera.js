// Where one looks from: a turn without poles, a distance, a shift, a lens. Lengths are the object's radii.
const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const TAN = Math.tan((35 / 2) * Math.PI / 180);
const FARTHEST = 40;

export class Camera {
  constructor() {
    this.axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]; // right, up, back
    this.target = [0, 0, 0];
    this.distance = 1.08 / Math.sin((35 / 2) * Math.PI / 180);
    this.size = [1, 1];
    this.half = [0, TAN]; // what must be seen to each side, as tangents
    this.middle = [0, 0]; // of the view, off the axis
    this.turn(0.5, 0.25);
  }

  // The tangent from the view's middle to its upper border
  get tan() { return Math.max(this.half[1], this.half[0] * this.size[1] / this.size[0]); }

  // Be a frame's camera, as the server tells it
  stand({ eye, axes, half, middle }) {
    Object.assign(this, { axes: axes.map((axis) => [...axis]), half, middle });
    this.distance = Math.max(dot(axes[2], eye), 0.05);
    this.target = add(eye, axes[2], -this.distance);
  }

  // The page's own lens again; the object stays as large
  release() {
    const before = this.tan;
    Object.assign(this, { half: [0, TAN], middle: [0, 0] });
    this.distance *= before / this.tan;
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

  zoom(factor) { this.distance = Math.min(Math.max(this.distance * factor, 0.05), Math.max(FARTHEST, this.distance)); }

  shift(dx, dy) {
    const step = 2 * this.tan * this.distance / this.size[1];
    this.target = add(add(this.target, this.axes[0], -dx * step), this.axes[1], dy * step);
  }

  // From where and whither a pixel looks, in radii about the centre
  ray(x, y) {
    const [w, h] = this.size;
    const u = this.middle[0] + (2 * x / w - 1) * this.tan * w / h, v = this.middle[1] + (1 - 2 * y / h) * this.tan;
    const [right, up, back] = this.axes;
    return [this.eye, right.map((r, i) => u * r + v * up[i] - back[i])];
  }

  // The pixel of a point, or null behind the camera
  project(point) {
    const from = add(point, this.eye, -1);
    const [x, y, z] = this.axes.map((axis) => dot(axis, from));
    if (z >= 0) return null;
    const [w, h] = this.size, [u, v] = [-x / z - this.middle[0], -y / z - this.middle[1]];
    return [w / 2 * (1 + u / (this.tan * w / h)), h / 2 * (1 - v / this.tan)];
  }

  // Column-major, for WebGL
  matrix() {
    const [right, up, back] = this.axes, eye = this.eye;
    const near = Math.max(this.distance - 4, this.distance / 200), far = this.distance + 6;
    const f = 1 / this.tan, a = f * this.size[1] / this.size[0];
    const p = (near + far) / (near - far), q = 2 * near * far / (near - far);
    const [across, upward] = [add(right, back, this.middle[0]), add(up, back, this.middle[1])];
    const rows = [
      [...across.map((x) => a * x), -a * dot(across, eye)],
      [...upward.map((x) => f * x), -f * dot(upward, eye)],
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
