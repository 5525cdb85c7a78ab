/** What the registration page asks the server. Every answer that is no success is a sentence. */

import { Refused, ask } from "../server/ask.js";

export { Refused };

const asked = (path, content) => ask(`/registration/${path}`, content);

export const start = () => asked("start");
export const progress = () => asked("progress");
export const open = (source, mirrored, diameter_mm) => asked("open", { source, mirrored, diameter_mm });
export const load = (number, path) => asked("load", { number, path });
export const save = (number, draft, path, picture, overwrite) => asked("save", { number, draft, path, picture, overwrite });

/** Checks drafts as fast as the server answers: of those that wait only the newest is sent. */
export class Checker {
  /** @param {(checked: any, draft: any) => void} onChecked @param {(sentence: string) => void} onRefused */
  constructor(onChecked, onRefused) { Object.assign(this, { onChecked, onRefused, waiting: null, isBusy: false }); }

  async check(number, draft) {
    this.waiting = { number, draft };
    if (this.isBusy) return;
    this.isBusy = true;
    try {
      while (this.waiting) {
        const asking = this.waiting;
        this.waiting = null;
        try {
          this.onChecked(await asked("check", asking), asking.draft);  // which may ask again
        } catch (error) {
          if (!(error instanceof Refused)) throw error;
          this.onRefused(error.message);
        }
      }
    } finally {
      this.isBusy = false;
    }
  }
}

/** Wait until the loop has started and its page is there; false if it does not come. */
export async function loopStarts(within_ms = 30_000) {
  for (const end_ms = performance.now() + within_ms; performance.now() < end_ms;) {
    try {
      const answer = await fetch("/");
      if (answer.ok && !answer.redirected) return true;
    } catch { /* between two servers nobody answers */ }
    await new Promise((resolve) => setTimeout(resolve, 300));
  }
  return false;
}
