/** The requests of the registration page. */

import { RequestError, request } from "../common/request.js";

/** Request a route. @type {<R extends keyof RegistrationRoutes>(route: R, body?: object) => Promise<RegistrationRoutes[R]>} */
export const call = (route, body) => request(`/registration/${route}`, body);

/** Checks drafts as fast as the server answers; of those that wait, only the newest. */
export class Checker {
  /** @type {{ number: number, draft: Draft } | null} */ waiting = null;
  isBusy = false;

  /** @param {(checked: CheckedDraft, draft: Draft) => void} onChecked @param {(sentence: string) => void} onRefused */
  constructor(onChecked, onRefused) { this.onChecked = onChecked; this.onRefused = onRefused; }

  async check(/** @type {number} */ number, /** @type {Draft} */ draft) {
    this.waiting = { number, draft };
    if (this.isBusy) return;
    this.isBusy = true;
    try {
      while (this.waiting) {
        /** @type {{ number: number, draft: Draft }} */ const body = this.waiting;
        this.waiting = null;
        try {
          this.onChecked(await call("check", body), body.draft);  // may call `check` again
        } catch (error) {
          if (!(error instanceof RequestError)) throw error;
          this.onRefused(error.message);
        }
      }
    } finally {
      this.isBusy = false;
    }
  }
}

/** Wait until the loop serves its page; false if it does not start. */
export async function loopStarts(timeout_ms = 30_000) {
  for (const end_ms = performance.now() + timeout_ms; performance.now() < end_ms;) {
    try {
      const response = await fetch("/");
      if (response.ok && !response.redirected) return true;
    } catch { /* no server between this one and the next */ }
    await new Promise((resolve) => setTimeout(resolve, 300));
  }
  return false;
}
