/** The status of a study, kept up to date: requested whenever a change is announced, one request at a time. */

import { RequestError, request } from "./request.js";

/** @template {StudyStatus} T */
export class Sync {
  version = -1; isOutdated = false;
  /** @type {Promise<void> | null} */ refreshing = null;

  /** @param {string} path of the routes, such as "/participant" @param {(status: T) => void} show called with every newer status */
  constructor(path, show) { this.path = path; this.show = show; }

  /** Request the status; calls during a request lead to one more. */
  refresh() {
    this.isOutdated = true;
    this.refreshing ??= this.requestAll().finally(() => { this.refreshing = null; });
    return this.refreshing;
  }

  async requestAll() {
    try {
      while (this.isOutdated) {
        this.isOutdated = false;
        this.accept(await request(`${this.path}/status`));
      }
    } catch (error) {
      if (!(error instanceof RequestError)) throw error;  // the socket breaks as well; on reconnection this is repeated
    }
  }

  /** Send an action, which is answered by the status after it.
   *  @param {string} name @param {object} body
   *  @throws {RequestError} */
  async act(name, body) { this.accept(await request(`${this.path}/${name}`, body)); }

  /** Forget the version: another server counts from the beginning. */
  reset() { this.version = -1; }

  accept(/** @type {T} */ status) {
    if (status.version < this.version) return;
    this.version = status.version;
    this.show(status);
  }
}
