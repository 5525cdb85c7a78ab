/** A questionnaire as a form: every answer is sent when it is given, and marked when it is saved.
 *
 * Answers that are not saved yet are sent again when the server responds and still expects them.
 */

import { $, make } from "../common/dom.js";
import { NoResponse, RequestError } from "../common/request.js";

const RETRY_MS = 700, TYPING_MS = 500;
const SAVED = "✓ saved";

export class Questionnaire {
  /** @type {Place | null} */ place = null;
  /** @type {Map<string, { item: QuestionnaireItem, field: HTMLFieldSetElement }>} */ items = new Map();
  /** Answers that are not saved yet, by item. @type {Map<string, string>} */ pending = new Map();
  /** Answers that are saved. @type {Map<string, string>} */ saved = new Map();
  /** @type {Promise<void> | null} */ sending = null;

  /** @param {HTMLFormElement} form @param {(answer: object) => Promise<void>} send
   *  @param {() => void} finish called when the questionnaire is complete
   *  @param {() => Promise<void>} refresh requests the status; `flush` is called if this questionnaire is still the next stage
   *  @param {(place: Place) => boolean} isNext whether a questionnaire is the next stage, as far as is known */
  constructor(form, send, finish, refresh, isNext) {
    this.form = form; this.send = send; this.finish = finish; this.refresh = refresh; this.isNext = isNext;
    form.addEventListener("submit", (event) => { event.preventDefault(); this.submit(); });
  }

  /** Show a questionnaire with its saved answers. @param {string} participant @param {QuestionnaireStage} stage */
  begin(participant, stage) {
    this.place = { participant, key: stage.key };
    this.pending = new Map();
    this.saved = new Map(Object.entries(stage.answers));
    $("questionnaire-title").textContent = stage.title;
    $("questionnaire-intro").textContent = stage.intro;
    $("questionnaire-source").textContent = stage.source.includes(" ") ? `Source: ${stage.source}` : "";
    this.items = new Map(stage.items.map((item, at) => [item.key, { item, field: this.field(item, at) }]));
    $("items").replaceChildren(...[...this.items.values()].map(({ field }) => field));
    for (const key of this.saved.keys()) this.mark(key, "is-saved", SAVED);
    this.count();
  }

  field(/** @type {QuestionnaireItem} */ item, /** @type {number} */ at) {
    const status = make("span", { className: "save-status", id: `status-${at}` });
    status.setAttribute("role", "status");
    const legend = make("legend", {}, `${at + 1}. ${item.text}`, !item.required && make("span", { className: "optional" }, " (optional)"));
    const field = make("fieldset", { className: "item" }, legend, ...this.inputs(item, at), status);
    field.dataset.item = item.key;
    return field;
  }

  /** @param {QuestionnaireItem} item @param {number} at @returns {(Node | string)[]} */
  inputs(item, at) {
    const given = this.saved.get(item.key) ?? "";
    if (item.kind === "scale" || item.kind === "choice") {
      const low = item.low ?? 0, numbers = Array.from({ length: (item.high ?? 0) - low + 1 }, (_, n) => String(low + n));
      const labels = (item.kind === "choice" ? item.choices : numbers).map((value) => {
        const input = make("input", { type: "radio", name: `item-${at}`, value, checked: value === given });
        input.addEventListener("change", () => this.give(item, value));
        return make("label", {}, input, value);
      });
      const end = (/** @type {string} */ text) => text && make("span", { className: "end" }, text);
      return [make("div", { className: "choices" }, end(item.low_label), ...labels, end(item.high_label))];
    }
    const input = item.kind === "text" ? make("textarea", { value: given }) : make("input", { value: given });
    input.autocomplete = "off";
    if (item.kind === "number") input.inputMode = "decimal";
    input.setAttribute("aria-label", item.unit ? `${item.text} In ${item.unit}` : item.text);
    input.setAttribute("aria-describedby", `status-${at}`);
    let timer = 0;
    input.addEventListener("input", () => { clearTimeout(timer); timer = setTimeout(() => this.give(item, input.value, true), TYPING_MS); });
    input.addEventListener("change", () => { clearTimeout(timer); this.give(item, input.value); });
    return item.unit ? [input, ` ${item.unit}`] : [input];
  }

  /** Take an answer; an incomplete one is marked only when its field is left. @param {QuestionnaireItem} item @param {string} text */
  give(item, text, isTyping = false) {
    const answer = text.trim().replace(item.kind === "number" ? "," : "\0", ".");
    if (answer && !isValid(item, answer)) {
      if (!isTyping) this.mark(item.key, "is-invalid", `! Please enter ${item.valid}.`);
      return;
    }
    if (answer === (this.pending.get(item.key) ?? this.saved.get(item.key) ?? "")) {
      if (answer && !this.pending.has(item.key)) this.mark(item.key, "is-saved", SAVED);
      return;
    }
    this.pending.set(item.key, answer);
    this.mark(item.key, "", "… not saved yet");
    this.flush();
  }

  /** Send the answers that are not saved yet, one after the other. */
  flush() {
    this.sending ??= this.sendAll().finally(() => { this.sending = null; if (this.place) this.count(); });
    return this.sending;
  }

  async sendAll() {
    while (this.pending.size && this.place) {
      const { place, pending } = this, [[item, answer]] = pending;
      if (!await this.sendOne(place, item, answer)) return;
      if (pending.get(item) === answer) pending.delete(item);
    }
  }

  /** Send one answer; false if the others should wait for the server. @param {Place} place @param {string} item @param {string} answer */
  async sendOne(place, item, answer) {
    try {
      await this.send({ ...place, item, answer });
    } catch (error) {
      if (error instanceof NoResponse) { setTimeout(this.refresh, RETRY_MS); return false; }
      if (!(error instanceof RequestError)) throw error;
      await this.refresh();
      if (!this.isNext(place)) return false;
      if (this.place === place) this.mark(item, "is-invalid", `! ${error.message}`);
      return true;
    }
    if (this.place !== place) return true;
    if (answer) this.saved.set(item, answer); else this.saved.delete(item);
    if (this.pending.get(item) === answer) this.mark(item, answer ? "is-saved" : "", answer ? SAVED : "");
    this.count();
    return true;
  }

  /** Send what is being typed, without waiting for more of it. */
  commit() {
    if (this.form.contains(document.activeElement)) document.activeElement?.dispatchEvent(new Event("change"));
    return this.flush();
  }

  async submit() {
    await this.commit();
    const invalid = this.form.querySelector(".is-invalid");
    const missing = [...this.items.values()].filter(({ item }) => item.required && !this.saved.has(item.key) && !this.pending.has(item.key));
    for (const { item, field } of missing) if (field !== invalid) this.mark(item.key, "is-invalid", "! Please answer this question.");
    const first = this.form.querySelector(".is-invalid"), input = first?.querySelector("input, textarea");
    if (!first && !this.pending.size) this.finish();
    first?.scrollIntoView({ block: "center" });
    if (input instanceof HTMLElement) input.focus({ preventScroll: true });
  }

  mark(/** @type {string} */ key, /** @type {string} */ className, /** @type {string} */ text) {
    const field = this.items.get(key)?.field;
    if (!field) return;
    field.className = `item ${className}`.trim();
    /** @type {Element} */ (field.querySelector(".save-status")).textContent = text;
    for (const input of field.querySelectorAll("input, textarea")) input.setAttribute("aria-invalid", String(className === "is-invalid"));
  }

  count() {
    const pending = this.pending.size ? `, ${this.pending.size} not saved yet` : "";
    $("answered").textContent = `${this.saved.size} of ${this.items.size} answered${pending}`;
  }
}

/** Return whether an answer is valid; the server decides. @param {QuestionnaireItem} item @param {string} answer */
function isValid(item, answer) {
  if (item.kind !== "number") return true;
  const number = Number(answer);
  return Number.isFinite(number) && (item.low === null || number >= item.low) && (item.high === null || number <= item.high);
}
