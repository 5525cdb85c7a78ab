/** A hint for the first visit; once it is closed, this browser does not show it again. */

import { make } from "./dom.js";

/** Show a hint above the page's parts, unless it was closed before. @param {string} key of the hint @param {string} text */
export function showHint(key, text) {
  const stored = `hint-${key}`;
  if (localStorage.getItem(stored) || document.getElementById("hint")) return;
  const button = make("button", { type: "button", textContent: "Got it" });
  const hint = make("aside", { id: "hint", ariaLabel: "Hint" }, make("span", {}, text), button);
  button.addEventListener("click", () => { hint.remove(); localStorage.setItem(stored, "closed"); });
  document.querySelector("main")?.before(hint);
}
