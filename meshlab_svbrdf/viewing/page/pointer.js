// Mouse, pen and touch: turns, shifts, zooms, clicks and strokes.
const STILL = 4; // pixels that a click may move

export class Pointer {
  constructor(canvas, does) {
    this.does = does;
    this.held = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      const [x, y] = [event.offsetX, event.offsetY];
      const draws = event.button === 0 && does.draws() && !this.held.size;
      this.held.set(event.pointerId, { x, y, from: [x, y], moved: false, button: event.button, draws });
      if (draws) does.draw(x, y, true, event.shiftKey);
    });
    canvas.addEventListener("pointermove", (event) => this.#move(event));
    canvas.addEventListener("pointerup", (event) => this.#up(event));
    canvas.addEventListener("pointercancel", (event) => this.held.delete(event.pointerId));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      does.zoom(Math.exp(0.0015 * Math.max(-240, Math.min(240, event.deltaY * (event.deltaMode ? 30 : 1)))));
    }, { passive: false });
  }

  #move(event) {
    const held = this.held.get(event.pointerId);
    if (!held) return;
    const [dx, dy] = [event.offsetX - held.x, event.offsetY - held.y];
    const others = [...this.held.entries()].filter(([id]) => id !== event.pointerId);
    if (others.length) {
      // Two fingers: pinch and shift
      const other = others[0][1], away = (x, y) => Math.hypot(x - other.x, y - other.y);
      this.does.zoom(away(held.x, held.y) / Math.max(1, away(event.offsetX, event.offsetY)));
      this.does.shift(dx / 2, dy / 2);
      held.moved = other.moved = true;
    } else if (held.draws) {
      if (Math.hypot(dx, dy) < 2) return;
      this.does.draw(event.offsetX, event.offsetY, false, event.shiftKey);
    } else {
      held.moved ||= Math.hypot(event.offsetX - held.from[0], event.offsetY - held.from[1]) > STILL;
      if (!held.moved) return;
      const turns = held.button === 0 ? !event.altKey : this.does.draws();
      this.does[turns ? "turn" : "shift"](dx, dy);
    }
    Object.assign(held, { x: event.offsetX, y: event.offsetY });
  }

  #up(event) {
    const held = this.held.get(event.pointerId);
    this.held.delete(event.pointerId);
    if (!held) return;
    if (held.draws) this.does.drawn(event.shiftKey);
    else if (!held.moved && held.button === 0)
      this.does.click(event.offsetX, event.offsetY, event.ctrlKey || event.shiftKey || event.metaKey);
  }
}
