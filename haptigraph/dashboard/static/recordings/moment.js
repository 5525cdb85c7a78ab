/** One recorded step on the page: image, state, graph and haptic output. */

import { $, showOrHide } from "../common/dom.js";
import { EyeCrop } from "./crop.js";
import { Graph } from "../common/graph.js";
import { unpack } from "../common/socket.js";
import { StatePanel } from "../common/state_panel.js";
import { get } from "./stream.js";
import { View } from "../common/view.js";

export class Moment {
  view = new View($("view"), $("overlays"));
  graph = new Graph($("graph"), true);
  panel = new StatePanel();
  name = "";
  /** @type {RecordedRun} */ run;
  /** @type {ComparedRun | null} */ other = null;
  /** @type {EyeCrop | null} */ crop = null;
  /** @type {ImageHeader | null} */ header = null;
  /** @type {number | null} */ wanted = null;
  isBusy = false;

  constructor(/** @type {(error: unknown) => void} */ onProblem) { this.onProblem = onProblem; }

  begin(/** @type {string} */ name, /** @type {RecordedRun} */ run) {
    const { hello, image_from_eye_px } = run.content;
    Object.assign(this, { name, run, other: null, header: null });
    this.crop = hello.view.across_mm === null ? new EyeCrop(hello.view, image_from_eye_px) : null;  // volumes come drawn
    this.panel.begin(hello);
    this.graph.begin(hello.procedure);
    this.view.begin(hello);
    delete document.body.dataset.step;
  }

  /** Show a step; of those that are requested while one is loading, only the newest. @param {number} number */
  async show(number) {
    this.wanted = number;
    if (this.isBusy) return;
    this.isBusy = true;
    try {
      while (this.wanted !== null) {
        const next = this.wanted;
        this.wanted = null;
        await this.fetch(next, this.run);
      }
    } catch (error) {
      this.wanted = null;
      this.onProblem(error);
    } finally {
      this.isBusy = false;
    }
  }

  async fetch(/** @type {number} */ number, /** @type {RecordedRun} */ run) {
    const response = await get("/recordings/step", { name: this.name, number: String(number) });
    const { header, picture } = unpack(await response.arrayBuffer());
    const image = picture && await (this.crop ? this.crop.crop(picture) : createImageBitmap(new Blob([picture], { type: "image/png" })));
    if (run !== this.run) { image?.close(); return; }  // another run has been opened
    await this.view.show(header, image);
    this.header = header;
    this.panel.show(header);
    this.graph.show(header);
    this.showMore();
    document.body.dataset.step = String(number);
  }

  /** Show what the image cannot: faults, that there is no image, the other procedure's state. */
  showMore() {
    const { header, run, other } = this;
    if (!header) return;
    $("no-picture").hidden = header.has_picture;
    showOrHide($("fault"), run.faultsAt(header.number).join("; "));
    $("instead").hidden = !other;
    if (!other) return;
    const { number } = header, state = other.stateAt(number), pattern = other.patternAt(number);
    $("instead").textContent = `${other.content.procedure}: ${other.labelOf(state)}, feels ${pattern === "off" ? "nothing" : pattern}`;
    $("instead").classList.toggle("differs", state !== run.stateAt(number) || pattern !== run.patternAt(number));
  }
}
