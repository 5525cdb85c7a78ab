/** The list of trocars: which one the needle is in, their names, one more, one less. Knows no server. */

import { MOST_TROCARS } from "./draft.js";

export class Trocars {
  /**
   * @param {HTMLElement} list
   * @param {HTMLButtonElement} more
   * @param {{used: (index: number) => void, rename: (index: number, name: string) => void,
   *          remove: (index: number) => void, add: () => void}} on what to call
   */
  constructor(list, more, on) {
    Object.assign(this, { list, more, on, draft: null });
    more.addEventListener("click", () => on.add());
  }

  show(draft) {
    this.draft = draft;
    const { length } = draft.trocars;
    while (this.list.children.length > length) this.list.lastChild.remove();
    while (this.list.children.length < length) this.list.append(this.made(this.list.children.length));
    draft.trocars.forEach(({ name, used }, index) => {
      const [radio, text, remove] = this.list.children[index].querySelectorAll("input, button");
      radio.checked = used;
      radio.setAttribute("aria-label", `The needle is in ${name}`);
      if (document.activeElement !== text) { text.value = name; text.setCustomValidity(""); }
      remove.disabled = length === 1;
      remove.setAttribute("aria-label", `Remove ${name}`);
    });
    this.more.disabled = length >= MOST_TROCARS;
  }

  made(index) {
    const item = document.createElement("li"), label = document.createElement("label");
    const radio = Object.assign(document.createElement("input"), { type: "radio", name: "used" });
    const text = Object.assign(document.createElement("input"), { type: "text", maxLength: 40, required: true, pattern: String.raw`[^"\\]*`, title: "Any name without \" and \\", spellcheck: false, autocomplete: "off" });
    const remove = Object.assign(document.createElement("button"), { type: "button", textContent: "Remove" });
    text.setAttribute("aria-label", `Name of trocar ${index + 1}`);
    label.append(radio, "needle in");
    item.append(label, text, remove);
    radio.addEventListener("change", () => this.on.used(index));
    remove.addEventListener("click", () => this.on.remove(index));
    text.addEventListener("input", () => this.rename(index, text));
    text.addEventListener("blur", () => this.show(this.draft));  // what was no name gives way to the name
    return item;
  }

  /** Rename as somebody types, as long as it is a name, and no other trocar's. */
  rename(index, text) {
    const name = text.value.trim(), isTaken = this.draft.trocars.some((each, number) => number !== index && each.name === name);
    text.setCustomValidity(isTaken ? "Another trocar has this name." : "");
    if (text.reportValidity() && name) this.on.rename(index, name);
  }
}
