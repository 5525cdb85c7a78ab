/** A questionnaire as a form: every answer goes to the server when it is given, and says when it is kept there.
 *
 * What is not kept yet is tried again when the server is back and still wants it.
 */

import { NoAnswer, Refused } from "../server/ask.js";

const AGAIN_MS = 700, TYPED_MS = 500;
const make = (name, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(name), properties);
  element.append(...children);
  return element;
};

export class Sheet {
  /**
   * @param {HTMLFormElement} form
   * @param {(name: string, content: any) => Promise<void>} send
   * @param {(name: string) => void} act tells what the server refuses
   * @param {() => Promise<void>} ask asks how things are; `flush` is called if this questionnaire still comes next
   * @param {(place: any) => boolean} isNext tells whether it does, as far as is known
   */
  constructor(form, send, act, ask, isNext) {
    Object.assign(this, { form, send, act, ask, isNext, place: null, items: new Map(), pending: new Map(), given: new Map(), sending: null });
    form.addEventListener("submit", (event) => { event.preventDefault(); this.handIn(); });
  }

  /** Show a questionnaire, with the answers that are kept. */
  begin(participant, stage) {
    this.place = { participant, key: stage.key };
    this.pending = new Map();
    this.given = new Map(Object.entries(stage.answers));
    this.find("sheet-title").textContent = stage.title;
    this.find("sheet-intro").textContent = stage.intro;
    this.find("sheet-source").textContent = stage.source.includes(" ") ? `Source: ${stage.source}` : "";
    this.items = new Map(stage.items.map((item, at) => [item.key, { item, field: this.field(item, at) }]));
    this.find("items").replaceChildren(...[...this.items.values()].map(({ field }) => field));
    for (const key of this.given.keys()) this.mark(key, "is-kept", "✓ kept");
    this.count();
  }

  find(id) { return this.form.querySelector(`#${id}`); }

  field(item, at) {
    const words = make("legend", {}, `${at + 1}. ${item.text}`);
    if (!item.required) words.append(make("span", { className: "optional" }, " (you may leave this out)"));
    const kept = make("span", { className: "kept", id: `kept-${at}` });
    kept.setAttribute("role", "status");
    const field = make("fieldset", { className: "item" }, words, ...this.inputs(item, at), kept);
    field.dataset.item = item.key;
    return field;
  }

  inputs(item, at) {
    const given = this.given.get(item.key) ?? "";
    if (item.kind === "scale" || item.kind === "choice") {
      const values = item.kind === "choice" ? item.choices : Array.from({ length: item.high - item.low + 1 }, (_, n) => String(item.low + n));
      const labels = values.map((value) => {
        const input = make("input", { type: "radio", name: `item-${at}`, value, checked: value === given });
        input.addEventListener("change", () => this.give(item, value));
        return make("label", {}, input, value);
      });
      const box = make("div", { className: "choices" });
      if (item.low_says) box.append(make("span", { className: "end" }, item.low_says));
      box.append(...labels);
      if (item.high_says) box.append(make("span", { className: "end" }, item.high_says));
      return [box];
    }
    const input = make(item.kind === "text" ? "textarea" : "input", { value: given, autocomplete: "off" });
    if (item.kind === "number") input.inputMode = "decimal";
    input.setAttribute("aria-label", item.unit ? `${item.text} In ${item.unit}` : item.text);
    input.setAttribute("aria-describedby", `kept-${at}`);
    let timer = 0;
    input.addEventListener("input", () => { clearTimeout(timer); timer = setTimeout(() => this.give(item, input.value, true), TYPED_MS); });
    input.addEventListener("change", () => { clearTimeout(timer); this.give(item, input.value); });
    return item.unit ? [input, ` ${item.unit}`] : [input];
  }

  /** Take an answer; one that is not whole yet is only told to be wrong when its field is left. */
  give(item, text, isTyping = false) {
    const answer = text.trim().replace(item.kind === "number" ? "," : "\0", ".");
    if (answer && !takes(item, answer)) {
      if (!isTyping) this.mark(item.key, "is-wrong", `! Please give ${item.valid}.`);
      return;
    }
    if (answer === (this.pending.get(item.key) ?? this.given.get(item.key) ?? "")) {
      if (answer && !this.pending.has(item.key)) this.mark(item.key, "is-kept", "✓ kept");
      return;
    }
    this.pending.set(item.key, answer);
    this.mark(item.key, "", "… not kept yet");
    this.flush();
  }

  /** Send what is not kept yet, one after the other. */
  flush() {
    this.sending ??= this.sendAll().finally(() => { this.sending = null; if (this.place) this.count(); });
    return this.sending;
  }

  async sendAll() {
    while (this.pending.size) {
      const { place, pending } = this, [item, answer] = pending.entries().next().value;
      if (!await this.sendOne(place, item, answer)) return;
      if (pending.get(item) === answer) pending.delete(item);
    }
  }

  /** Send one answer; false if it is better to wait until the page hears from the server. */
  async sendOne(place, item, answer) {
    try {
      await this.send("answer", { ...place, item, answer });
    } catch (error) {
      if (error instanceof NoAnswer) { setTimeout(this.ask, AGAIN_MS); return false; }
      if (!(error instanceof Refused)) throw error;
      await this.ask();
      if (!this.isNext(place)) return false;
      if (this.place === place) this.mark(item, "is-wrong", `! ${error.message}`);
      return true;
    }
    if (this.place !== place) return true;
    if (answer) this.given.set(item, answer); else this.given.delete(item);
    if (this.pending.get(item) === answer) this.mark(item, answer ? "is-kept" : "", answer ? "✓ kept" : "");
    this.count();
    return true;
  }

  /** Send what is typed, without waiting for more of it. */
  keep() {
    if (this.form.contains(document.activeElement)) document.activeElement.dispatchEvent(new Event("change"));
    return this.flush();
  }

  async handIn() {
    await this.keep();
    const wrong = this.form.querySelector(".is-wrong");
    const missing = [...this.items.values()].filter(({ item }) => item.required && !this.given.has(item.key) && !this.pending.has(item.key));
    for (const { item, field } of missing) if (field !== wrong) this.mark(item.key, "is-wrong", "! Please answer this one.");
    const first = this.form.querySelector(".is-wrong");
    if (first) { first.scrollIntoView({ block: "center" }); first.querySelector("input, textarea").focus({ preventScroll: true }); return; }
    if (!this.pending.size) this.act("done");
  }

  mark(key, className, words) {
    const field = this.items.get(key)?.field;
    if (!field) return;
    field.className = `item ${className}`.trim();
    field.querySelector(".kept").textContent = words;
    for (const input of field.querySelectorAll("input, textarea")) input.setAttribute("aria-invalid", className === "is-wrong");
  }

  count() {
    const waits = this.pending.size ? `, ${this.pending.size} not kept yet` : "";
    this.find("answered").textContent = `${this.given.size} of ${this.items.size} answered${waits}`;
  }
}

/** Tell whether an item takes an answer; the server has the last word. */
function takes(item, answer) {
  if (item.kind !== "number") return true;
  const number = Number(answer);
  return Number.isFinite(number) && (item.low === null || number >= item.low) && (item.high === null || number <= item.high);
}
