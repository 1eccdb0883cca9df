// A frame beside the object, as its camera saw it, with the picked point marked.
import { picture } from "./api.js";
import { Camera } from "./camera.js";

export class Shot {
  constructor(box) {
    [this.box, this.canvas, this.words] = [box, box.querySelector("canvas"), box.querySelector("figcaption")];
    this.camera = new Camera();
    this.asked = 0;
  }

  // lens: as the server tells it; a frame that is not there leaves its place empty and says so
  async show(frame, name, lens) {
    const asked = ++this.asked;
    this.camera.stand(lens);
    this.box.hidden = false;
    let [image, words] = [null, name];
    try { image = await picture(`picture?frame=${frame}`); } catch (error) { words = error.message; }
    if (asked !== this.asked) return;
    [this.image, this.words.textContent] = [image, words];
    this.draw();
  }

  hide() { this.asked++; this.box.hidden = true; }

  // place: of the picked point, in radii about the centre; faint: it is on the far side
  mark(place, faint) { [this.place, this.faint] = [place, faint]; this.draw(); }

  draw() {
    const { canvas, image } = this, paper = canvas.getContext("2d");
    Object.assign(canvas, { width: image?.width ?? 1, height: image?.height ?? 1 });
    if (!image) return;
    paper.drawImage(image, 0, 0);
    this.camera.size = [image.width, image.height];
    const at = this.place && this.camera.project(this.place);
    if (at) ring(paper, at, image.width / Math.max(1, canvas.clientWidth), this.faint);
  }
}

// A ring around a pixel; scale: of pixels to those of the screen
export function ring(paper, [x, y], scale = 1, faint = false) {
  paper.globalAlpha = faint ? 0.25 : 1;
  for (const [color, width] of [["#000a", 4], ["#fff", 2]]) {
    Object.assign(paper, { strokeStyle: color, lineWidth: scale * width });
    paper.beginPath();
    paper.arc(x, y, scale * 6, 0, 2 * Math.PI);
    paper.stroke();
  }
  paper.globalAlpha = 1;
}
