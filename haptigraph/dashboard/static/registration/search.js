/** The search for the eye in a source: its progress, how it is cancelled, and how a reloaded page goes on with it. */

import { $ } from "../common/dom.js";
import { RequestError } from "../common/request.js";
import { call } from "./service.js";

/** @typedef {{ source: string, mirrored: boolean, diameter_mm: number }} Wanted */

const PROGRESS_MS = 500, STORED = "registration search";
const CANCELLED = "The search was cancelled; “Find the eye” starts it again.";

export class Search {
  isOpen = false;

  /** @param {(opened: OpenedSource) => void} onOpened @param {(sentence: string) => void} onGivenUp called with the reason, or with nothing */
  constructor(onOpened, onGivenUp) { this.onOpened = onOpened; this.onGivenUp = onGivenUp; }

  /** The search of this tab before it was reloaded. @returns {Wanted | null} */
  get stored() { return JSON.parse(sessionStorage.getItem(STORED) ?? "null"); }

  /** Find the eye; return whether a source is open then. @param {Wanted} wanted
   *  @param {boolean} [resume] whether to go on with the same search, or with its result, and not to begin it anew */
  async find(wanted, resume = false) {
    const started_ms = performance.now();
    sessionStorage.setItem(STORED, JSON.stringify(wanted));
    this.showWaiting(true);
    $("doing").textContent = "Opening";
    const polling = setInterval(() => this.showProgress(started_ms), PROGRESS_MS);
    $("stop").onclick = () => call("cancel", wanted);
    try {
      const opened = await call("open", { ...wanted, resume });
      if ("cancelled" in opened) this.giveUp(resume ? "" : CANCELLED);
      else { this.isOpen = true; this.onOpened(opened); }
    } catch (error) {
      if (!(error instanceof RequestError)) throw error;
      this.giveUp(error.message);
    } finally {
      clearInterval(polling);
      this.showWaiting(false);
    }
    return this.isOpen;
  }

  giveUp(/** @type {string} */ sentence) {
    sessionStorage.removeItem(STORED);
    $("doing").textContent = "No picture";
    this.onGivenUp(sentence);
  }

  async showProgress(/** @type {number} */ started_ms) {
    const progress = await call("progress").then((answer) => answer.progress, () => "");
    if ($("find").disabled && progress) $("doing").textContent = `${progress[0].toUpperCase()}${progress.slice(1)}, ${Math.round((performance.now() - started_ms) / 1000)} s`;
  }

  showWaiting(/** @type {boolean} */ isWaiting) {
    $("find").disabled = isWaiting;
    $("picture-panel").classList.toggle("busy", isWaiting);
    $("done").hidden = $("stop").hidden = !isWaiting;
    $("waiting").hidden = !isWaiting && this.isOpen;
  }
}
