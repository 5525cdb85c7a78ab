/** The test of the haptic feedback before a trial: which outputs work, a pulse on them, and whether it was felt. */

import { $, setText } from "../common/dom.js";

const SHORTEST_MS = 1;
/** Outputs that are seen or heard. */ const NOTICED = /^(screen|sound)( \+ (screen|sound))*$/;

export class TouchCheck {
  named = "[]";
  /** The test pulse: waiting for its answer, or not felt. @type {"" | "played" | "unfelt"} */ pulse = "";
  /** @type {TouchStatus} */ status = { output: "", problem: "" };

  /** @param {import("../common/feed.js").Feed} feed
   *  @param {import("../live/outputs.js").Outputs} outputs of this page
   *  @param {(name: string, more?: object) => Promise<boolean>} act sends an action of the participant, and returns whether it succeeded */
  constructor(feed, outputs, act) {
    this.feed = feed; this.outputs = outputs;
    outputs.rumble.onPlayed = (start_ms, end_ms) => this.report(start_ms, end_ms);
    $("pulse").addEventListener("click", async () => {
      this.pulse = "";
      this.pulse = await act("pulse") ? "played" : "";
      this.update();
      $("touch-check").focus();  // not the answer, which a second key press would give
    });
    for (const [button, is_felt] of /** @type {const} */ ([["felt", true], ["unfelt", false]])) {
      $(button).addEventListener("click", async () => {
        this.pulse = await act("felt", { is_felt }) && !is_felt ? "unfelt" : "";
        this.update();
        (is_felt ? $("begin") : $("touch-check")).focus();
      });
    }
  }

  /** Name the outputs that work to the server, whenever they change. */
  name() {
    const names = document.hidden ? [] : this.outputs.names(), text = JSON.stringify(names);
    if (text === this.named || !this.feed.isOpen) return;
    this.named = text;
    this.feed.send({ type: "outputs", names });
  }

  /** Forget what the server knows: it is another, or the connection is new. */
  reset() { this.named = "[]"; }

  /** Report that the controller has vibrated. @param {number} start_ms on this page's clock @param {number} end_ms */
  report(start_ms, end_ms) {
    const offset_ms = this.feed.clock.now_ms() - performance.now();
    if (Number.isNaN(offset_ms) || end_ms - start_ms < SHORTEST_MS) return;
    this.feed.send({ type: "played", output: "controller", start_ms: start_ms + offset_ms, end_ms: end_ms + offset_ms });
  }

  /** @param {TouchStatus} status */
  show(status) {
    if (status.output !== this.status.output || !status.problem) this.pulse = "";
    this.status = status;
    this.update();
  }

  update() {
    const { output, problem } = this.status, isAsked = this.pulse === "played";
    $("begin").disabled = Boolean(problem);
    $("touch-check").hidden = !problem;
    $("pulse").hidden = !output || isAsked;
    $("felt").hidden = $("unfelt").hidden = !isAsked;
    const question = NOTICED.test(output) ? "Did you notice it?" : "Did you feel it?";
    setText($("touch-text"), !output ? `${problem[0]?.toUpperCase() ?? ""}${problem.slice(1)}.` : isAsked ? question
      : this.pulse === "unfelt" ? "Please tell the experimenter. Then test it again."
      : `Before you begin, test the haptic feedback (${output}).`);
  }
}
