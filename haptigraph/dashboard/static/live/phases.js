/** The phases of the operation: the current one, and buttons (and keys 1 to 9) to enter another. */

import { make } from "../common/dom.js";

export class Phases {
  /** @type {Map<string, HTMLButtonElement>} */ buttons = new Map();

  constructor(/** @type {HTMLFieldSetElement} */ root, /** @type {Send} */ send) {
    this.root = root; this.send = send;
    document.addEventListener("keydown", (event) => {
      const isTyping = event.target instanceof Element && event.target.closest("input, select, dialog");
      if (!isTyping && !event.ctrlKey && !event.altKey && !event.metaKey) [...this.buttons.values()][Number(event.key) - 1]?.click();
    });
  }

  begin(/** @type {Hello} */ { procedure }) {
    const names = procedure.entities.filter((entity) => entity.geometry === "phase").map((entity) => entity.name);
    this.buttons = new Map(names.map((name, at) => [name, this.button(name, at + 1)]));
    this.root.hidden = !names.length;
    this.root.replaceChildren(/** @type {Node} */ (this.root.querySelector("legend")), ...this.buttons.values());
  }

  button(/** @type {string} */ name, /** @type {number} */ key) {
    const button = make("button", { type: "button", textContent: name.replaceAll("_", " "), title: `Key ${key}` });
    button.addEventListener("click", () => this.send({ type: "enter_phase", phase: name }));
    return button;
  }

  show(/** @type {ImageHeader} */ header) {
    for (const [name, button] of this.buttons) {
      const isOn = header.nodes.includes(name);
      button.setAttribute("aria-pressed", String(isOn));
      button.classList.toggle("primary", isOn);
    }
  }

  /** Allow or forbid this page to enter phases. @param {boolean} isAllowed */
  allow(isAllowed) { this.root.disabled = !isAllowed; }
}
