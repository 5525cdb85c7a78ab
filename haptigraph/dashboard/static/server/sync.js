/** What the server says of the study, kept up to date: asked for when a change is told, one question at a time. */

import { Refused, ask } from "./ask.js";

export class Sync {
  /**
   * @param {string} path of the routes, such as "/participant"
   * @param {(now: any) => void} show called with every newer answer
   */
  constructor(path, show) { Object.assign(this, { path, show, version: -1, asking: null, again: false }); }

  /** Ask how things are; of several calls at once the last counts. */
  refresh() {
    this.again = true;
    this.asking ??= this.askAgain().finally(() => { this.asking = null; });
    return this.asking;
  }

  async askAgain() {
    try {
      while (this.again) {
        this.again = false;
        this.take(await ask(`${this.path}/now`));
      }
    } catch (error) {
      if (!(error instanceof Refused)) throw error;  // the line breaks as well, and when it is back it is asked again
    }
  }

  /**
   * Do something; the answer is how things are then.
   *
   * @throws {import("./ask.js").Refused}
   */
  async act(name, content) { this.take(await ask(`${this.path}/${name}`, content)); }

  /** Another server counts from the beginning. */
  forget() { this.version = -1; }

  take(now) {
    if (now.version < this.version) return;
    this.version = now.version;
    this.show(now);
  }
}
