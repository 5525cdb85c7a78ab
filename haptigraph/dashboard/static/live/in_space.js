/** Shows how far the needle is out of the section; once depth has shown it, also that it is unknown. */

import { $, showOrHide } from "../common/dom.js";

export class InSpace {
  hasDepth = false;

  begin() { this.hasDepth = false; }

  show(/** @type {ImageHeader} */ { in_space }) {
    this.hasDepth ||= Boolean(in_space);
    showOrHide($("in-space"), this.hasDepth ? `Out of the section: ${in_space || "unknown"}` : "");
  }
}
