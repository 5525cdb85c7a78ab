/** A magnifier beside the handle that is being moved: the picture's pixels, with the lines over them. */

const FACTOR = 8, DISTANCE_PX = 120;

export class Loupe {
  constructor(/** @type {HTMLCanvasElement} */ canvas, /** @type {HTMLImageElement} */ image, /** @type {SVGSVGElement} */ overlay) {
    this.canvas = canvas; this.image = image; this.overlay = overlay;
    this.context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d", { alpha: false }));
  }

  /** Magnify a position [px of the image]; null: hide the loupe. @param {Vec | null} at @param {Draft} draft @param {Vec[]} outline_px */
  show(at, draft, outline_px) {
    this.canvas.hidden = at === null;
    if (at === null) return;
    const { context: c, canvas: { width } } = this;
    const half = width / 2 / FACTOR;
    c.imageSmoothingEnabled = false;
    c.fillStyle = "#000";
    c.fillRect(0, 0, width, width);
    c.save();
    c.scale(FACTOR, FACTOR);
    c.translate(half - at[0], half - at[1]);
    c.drawImage(this.image, -0.5, -0.5);
    const colors = getComputedStyle(this.overlay);
    c.lineWidth = 1.5 / FACTOR;
    this.drawLine([...outline_px, ...outline_px.slice(0, 1)], colors.getPropertyValue("--globe"));
    this.drawLine(draft.contour_px, colors.getPropertyValue("--retina"));
    c.restore();
    c.strokeStyle = "#fff";
    c.lineWidth = 1;
    c.beginPath();
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      c.moveTo(width / 2 + 7 * dx, width / 2 + 7 * dy);
      c.lineTo(width / 2 + 22 * dx, width / 2 + 22 * dy);
    }
    c.stroke();
    this.moveBeside(at);
  }

  drawLine(/** @type {Vec[]} */ points, /** @type {string} */ color) {
    const c = this.context;
    c.strokeStyle = color;
    c.beginPath();
    points.forEach(([x, y], number) => (number ? c.lineTo(x, y) : c.moveTo(x, y)));
    c.stroke();
  }

  /** Move beside a position, to the side that has room. @param {Vec} at */
  moveBeside(at) {
    const { x, y } = new DOMPoint(...at).matrixTransform(this.overlay.getScreenCTM() ?? undefined);
    const box = /** @type {Element} */ (this.canvas.parentElement).getBoundingClientRect(), side = this.canvas.offsetWidth;
    const right = x - box.left + DISTANCE_PX + side / 2 < box.width ? 1 : -1;
    const down = y - box.top - DISTANCE_PX - side / 2 > 0 ? -1 : 1;
    this.canvas.style.left = `${x - box.left + right * DISTANCE_PX - side / 2}px`;
    this.canvas.style.top = `${y - box.top + down * DISTANCE_PX - side / 2}px`;
  }
}
