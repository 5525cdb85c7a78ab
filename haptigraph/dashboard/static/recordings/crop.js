/** Crops recorded images like those of the live page: the eye alone, scaled, grey, as the surgeon sees it. */

const SIDE = 560, MARGIN = 1.03;

export class EyeCrop {
  /** @param {{half_mm: number}} view of the run @param {[Vec, Vec, Vec]} axes_px positions of (0, 0), (1, 0) and (0, 1) mm of the eye frame in the image */
  constructor({ half_mm }, [origin, right, up]) {
    const scale = SIDE / (2 * half_mm);
    const view = new DOMMatrix([scale, 0, 0, -scale, half_mm * scale, half_mm * scale]);
    // 0.5: pixel centres have integer coordinates in the registration, and half-integer ones on a canvas.
    const image = new DOMMatrix([right[0] - origin[0], right[1] - origin[1], up[0] - origin[0], up[1] - origin[1], origin[0] + 0.5, origin[1] + 0.5]);
    this.viewFromImage = view.multiply(image.inverse());
  }

  /** Crop a JPEG or PNG. @param {Uint8Array<ArrayBuffer>} bytes */
  async crop(bytes) {
    const image = await createImageBitmap(new Blob([bytes], { type: bytes[0] === 0xff ? "image/jpeg" : "image/png" }));
    const canvas = new OffscreenCanvas(SIDE, SIDE), c = /** @type {OffscreenCanvasRenderingContext2D} */ (canvas.getContext("2d"));
    c.fillRect(0, 0, SIDE, SIDE);
    c.beginPath();
    c.arc(SIDE / 2, SIDE / 2, SIDE / 2 / MARGIN, 0, 2 * Math.PI);
    c.clip();
    c.setTransform(this.viewFromImage);
    c.imageSmoothingQuality = "high";
    c.drawImage(image, 0, 0);
    c.resetTransform();
    c.globalCompositeOperation = "saturation";  // grey, whatever the camera's colours
    c.fillStyle = "#808080";
    c.fillRect(0, 0, SIDE, SIDE);
    image.close();
    return canvas.transferToImageBitmap();
  }
}
