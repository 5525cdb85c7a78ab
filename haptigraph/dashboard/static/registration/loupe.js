/** A magnifier beside the handle that is being moved: the picture's own pixels, and the lines over it. */

const TIMES = 8, AWAY_PX = 120;

export class Loupe {
  /** @param {HTMLCanvasElement} canvas @param {HTMLImageElement} image @param {SVGSVGElement} overlay */
  constructor(canvas, image, overlay) {
    Object.assign(this, { canvas, image, overlay });
    this.context = canvas.getContext("2d", { alpha: false });
  }

  /** Look at a place [px of the image]; null: no more. */
  look(at, draft, outline_px) {
    this.canvas.hidden = at === null;
    if (at === null) return;
    const { context: c, canvas: { width } } = this;
    const half = width / 2 / TIMES;
    c.imageSmoothingEnabled = false;
    c.fillStyle = "#000";
    c.fillRect(0, 0, width, width);
    c.save();
    c.scale(TIMES, TIMES);
    c.translate(half - at[0], half - at[1]);
    c.drawImage(this.image, -0.5, -0.5);
    const inks = getComputedStyle(this.overlay);
    c.lineWidth = 1.5 / TIMES;
    this.chain([...outline_px, outline_px[0]], inks.getPropertyValue("--globe"));
    this.chain(draft.contour_px, inks.getPropertyValue("--retina"));
    c.restore();
    c.strokeStyle = "#fff";
    c.lineWidth = 1;
    c.beginPath();
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      c.moveTo(width / 2 + 7 * dx, width / 2 + 7 * dy);
      c.lineTo(width / 2 + 22 * dx, width / 2 + 22 * dy);
    }
    c.stroke();
    this.stand(at);
  }

  chain(places, ink) {
    const c = this.context;
    if (!places[0]) return;
    c.strokeStyle = ink;
    c.beginPath();
    places.forEach(([x, y], number) => (number ? c.lineTo(x, y) : c.moveTo(x, y)));
    c.stroke();
  }

  /** Stand beside the place, on the side where there is room. */
  stand(at) {
    const { x, y } = new DOMPoint(...at).matrixTransform(this.overlay.getScreenCTM());
    const room = this.canvas.parentElement.getBoundingClientRect(), side = this.canvas.offsetWidth;
    const right = x - room.left + AWAY_PX + side / 2 < room.width ? 1 : -1;
    const down = y - room.top - AWAY_PX - side / 2 > 0 ? -1 : 1;
    this.canvas.style.left = `${x - room.left + right * AWAY_PX - side / 2}px`;
    this.canvas.style.top = `${y - room.top + down * AWAY_PX - side / 2}px`;
  }
}
