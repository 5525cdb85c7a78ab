/** The list of trocars: the one that the needle is in, their names, and buttons to add and remove. */

import { make } from "../common/dom.js";
import { MAX_TROCARS } from "./draft.js";

export class Trocars {
  /** @type {Draft} */ draft;
  /** @type {TrocarRow[]} */ rows = [];

  /** @param {HTMLElement} list @param {HTMLButtonElement} addButton
   *  @param {{used: (index: number) => void, rename: (index: number, name: string) => void,
   *           remove: (index: number) => void, add: () => void}} actions */
  constructor(list, addButton, actions) {
    this.list = list; this.addButton = addButton; this.actions = actions;
    addButton.addEventListener("click", () => actions.add());
  }

  show(/** @type {Draft} */ draft) {
    const { length } = draft.trocars;
    this.draft = draft;
    for (const { item } of this.rows.splice(length)) item.remove();
    while (this.rows.length < length) this.rows.push(this.addRow(this.rows.length));
    draft.trocars.forEach(({ name, used }, index) => {
      const { radio, text, remove } = this.rows[index];
      radio.checked = used;
      radio.ariaLabel = `${name} in use: the needle is in this trocar`;
      if (document.activeElement !== text) { text.value = name; text.setCustomValidity(""); }
      remove.disabled = length === 1;
      remove.ariaLabel = `Remove ${name}`;
    });
    this.addButton.disabled = length >= MAX_TROCARS;
  }

  /** @param {number} index @returns {TrocarRow} */
  addRow(index) {
    const radio = make("input", { type: "radio", name: "used" }), remove = make("button", { type: "button", textContent: "Remove" });
    const text = make("input", { type: "text", maxLength: 40, required: true, pattern: String.raw`[^"\\]*`, title: "Any name without \" and \\", spellcheck: false, autocomplete: "off", ariaLabel: `Name of trocar ${index + 1}` });
    const item = make("li", {}, make("label", {}, radio, "in use"), text, remove);
    radio.addEventListener("change", () => this.actions.used(index));
    remove.addEventListener("click", () => this.actions.remove(index));
    text.addEventListener("input", () => this.rename(index, text));
    text.addEventListener("blur", () => this.show(this.draft));  // an invalid name is replaced by the last valid one
    this.list.append(item);
    return { item, radio, text, remove };
  }

  /** Rename during typing, as long as the name is valid and not another trocar's. @param {number} index @param {HTMLInputElement} text */
  rename(index, text) {
    const name = text.value.trim(), isTaken = this.draft.trocars.some((each, number) => number !== index && each.name === name);
    text.setCustomValidity(isTaken ? "Another trocar has this name." : "");
    if (text.reportValidity() && name) this.actions.rename(index, name);
  }
}
