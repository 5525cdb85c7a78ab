/** The colours of style.css for canvases, which cannot use custom properties; they follow the theme. */

import { make } from "../common/dom.js";

const NAMES = /** @type {const} */ (["panel", "raised", "line", "text", "quiet", "good", "warn"]);
/** @type {Record<typeof NAMES[number], string>} */
export const colors = { panel: "", raised: "", line: "", text: "", quiet: "", good: "", warn: "" };
/** Called when the colours have changed. @type {(() => void)[]} */
export const onRecolor = [];

function read() {
  const probe = make("i");
  document.body.append(probe);
  for (const name of NAMES) {
    probe.style.color = `var(--${name})`;
    colors[name] = getComputedStyle(probe).color;
  }
  probe.remove();
  for (const act of onRecolor) act();
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", read);
new MutationObserver(read).observe(document.documentElement, { attributeFilter: ["data-theme"] });
read();
