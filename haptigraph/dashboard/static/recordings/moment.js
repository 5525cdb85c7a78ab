/** One moment of a run on the page: image, state, graph and touch of one recorded step, all at once. */

import { asked } from "./frames.js";
import { Graph } from "../server/graph.js";
import { PictureMaker } from "./picture.js";
import { unpacked } from "../server/socket.js";
import { Status } from "../server/status.js";
import { View } from "../server/view.js";

const $ = (id) => document.getElementById(id);

export class Moment {
  /** @param {(error: Error) => void} onProblem */
  constructor(onProblem) {
    this.view = new View($("view"), $("overlays"));
    this.graph = new Graph($("graph"), true);
    this.status = new Status();
    this.onProblem = onProblem;
    this.wanted = this.run = this.other = null;
    this.isBusy = false;
  }

  begin(name, run) {
    const { hello, image_from_eye_px } = run.content;
    Object.assign(this, { name, run, other: null, header: null });
    this.maker = new PictureMaker(hello.view, image_from_eye_px);
    this.status.begin(hello);
    this.graph.begin(hello.procedure);
    this.view.begin(hello);
    delete document.body.dataset.step;
  }

  /** Show a step; of those that are asked for while one is on its way, only the newest. */
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

  async fetch(number, run) {
    const answer = await asked("/recordings/step", { name: this.name, number });
    const { header, picture } = unpacked(await answer.arrayBuffer());
    const image = picture && await this.maker.make(picture);
    if (run !== this.run) { image?.close(); return; }  // another run was opened meanwhile
    await this.view.show(header, image);
    this.header = header;
    this.status.show(header);
    this.graph.show(header);
    this.showMore();
    document.body.dataset.step = number;
  }

  /** Say what an image cannot: faults, a missing image, what another procedure makes of it. */
  showMore() {
    const { header, run, other } = this;
    if (!header) return;
    $("no-picture").hidden = header.has_picture;
    $("fault").hidden = !header.faults.length;
    $("fault").textContent = header.faults.join("; ");
    $("instead").hidden = !other;
    if (!other) return;
    const { number } = header, state = other.stateAt(number), plays = other.playsAt(number);
    const label = other.described.find((each) => each.name === state)?.label ?? state;
    $("instead").textContent = `${other.content.procedure}: ${label}, feels ${plays === "off" ? "nothing" : plays}`;
    $("instead").classList.toggle("differs", state !== run.stateAt(number) || plays !== run.playsAt(number));
  }
}
