/** Says that positions are assumed and not measured, and where to state them. */

import { make } from "../common/dom.js";

export class Assumed {
  /** @param {HTMLElement} picture the notice stands above it */
  constructor(picture) {
    this.text = make("span");
    this.notice = make("p", { id: "assumed", hidden: true }, this.text, make("a", { href: "/registration", textContent: "Set it on the registration page" }));
    this.notice.setAttribute("role", "status");
    picture.parentElement?.before(this.notice);
  }

  begin(/** @type {Hello} */ { assumed, silenced }) {
    const isTarget = assumed.includes("target"), others = assumed.filter((name) => name !== "target");
    this.notice.hidden = !assumed.length;
    this.notice.classList.toggle("bad", isTarget || silenced);
    const what = isTarget ? `The target is assumed, not measured${others.length ? ` (also: ${others.join(", ")})` : ""}` : `Assumed, not measured: ${others.join(", ")}`;
    const effect = silenced ? "; haptic output is off" : isTarget ? "; contacts and hits are judged by a guess" : "";
    this.text.textContent = `${what}${effect}. `;
  }
}
