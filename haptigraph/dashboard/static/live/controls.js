/** The panel of the controls: who holds them, how hand becomes tool, and what the controller does now. */

import { ACTIONS, moved } from "./gamepad.js";
import { actuatorOf } from "./rumble.js";
import { toggle } from "../server/signs.js";

const TREMOR_MM = 1.0;
const $ = (id) => document.getElementById(id);

export class Controls {
  /**
   * @param {(message: any) => void} send
   * @param {import("./steering.js").Steering} steering
   * @param {import("./gamepad.js").Controller} controller
   */
  constructor(send, steering, controller) {
    Object.assign(this, { send, steering, controller, me: "", holder: "", settings: null, waits: null });
    $("hold").addEventListener("click", () => this.send({ type: this.holder === this.me ? "release" : "take" }));
    $("scale").addEventListener("input", () => this.tune({ motion_scale: Number($("scale").value) }));
    $("scale").addEventListener("pointerup", () => $("scale").blur());  // so that the arrow keys steer again
    $("filter").addEventListener("change", () => this.tune({ tremor_filter: $("filter").checked }));
    $("tremor").addEventListener("change", () => this.tune({ added_tremor_mm: $("tremor").checked ? TREMOR_MM : 0 }));
    $("switches").append(toggle("Needs clutch", false, (on) => { steering.needsClutch = on; }, "needs-clutch"));
    $("map").addEventListener("click", () => { this.fillDialog(); $("mapping").showModal(); });
    $("standard").addEventListener("click", () => { controller.standard(); this.fillDialog(); });
    steering.onFilter = () => this.tune({ tremor_filter: !this.settings.tremor_filter });
  }

  begin(hello) {
    const { steerable, has_jaws } = hello;
    this.steering.begin(hello);
    $("steering").hidden = !steerable;
    $("jaws").hidden = !has_jaws;
    document.querySelector("main").classList.toggle("steerable", steerable);
    if (steerable && !document.hidden) this.send({ type: "take" });
  }

  tune(change) { this.send({ type: "tune", ...change }); }

  showSettings(settings) {
    this.settings = settings;
    if (document.activeElement !== $("scale")) $("scale").value = settings.motion_scale;
    $("scale-value").textContent = `× ${settings.motion_scale.toFixed(2)}`;
    $("filter").checked = settings.tremor_filter;
    $("tremor").checked = settings.added_tremor_mm > 0;
  }

  showHolder(holder) {
    const isMine = holder !== "" && holder === this.me;
    this.holder = holder;
    if (this.steering.isHolder && !isMine) this.steering.letGo();
    this.steering.isHolder = isMine;
    $("holder").textContent = isMine ? "You hold the controls" : holder ? `${holder} holds the controls` : "Nobody holds the controls";
    $("hold").textContent = isMine ? "Let go" : "Take";
    $("hold").disabled = holder !== "" && !isMine;
    $("hold").classList.toggle("primary", holder === "");
    for (const id of ["scale", "filter", "tremor"]) $(id).disabled = !isMine;
  }

  /** Show what the inputs do now; called with every drawn image. */
  show() {
    const pad = this.controller.pad();
    const engaged = this.steering.engaged;
    $("clutch").textContent = engaged ? "● moving the instrument" : "○ hand is off";
    $("clutch").classList.toggle("on", engaged);
    $("pad").textContent = pad ? `${shortName(pad.id)}${actuatorOf(pad) ? ", can vibrate" : ", cannot vibrate: switch on screen or sound"}` : "No controller: press one of its buttons to connect it";
    $("map").hidden = !pad;
    if (!$("mapping").open) return;
    if (!pad) { $("mapping").close(); return; }
    bars($("axes"), pad.axes.map((value) => ({ low: Math.min(value, 0), high: Math.max(value, 0), on: Math.abs(value) > 0.35 })), "axis");
    bars($("buttons"), pad.buttons.map((button) => ({ low: 0, high: button.value, on: button.pressed })), "button");
    this.listen(pad);
  }

  fillDialog() {
    const { mapping } = this.controller;
    const actions = Object.entries(ACTIONS).filter(([, { ofJaws }]) => !ofJaws || this.steering.hasJaws);  // jaws are last
    this.waits = null;
    $("actions").replaceChildren(...actions.map(([action, { words, kind }]) => {
      const { index, sign } = mapping[action];
      const row = document.createElement("tr");
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: "Change", ariaLabel: `Change ${words}` });
      button.addEventListener("click", () => this.wait(action, row, kind));
      for (const cell of [words, `${kind} ${index}${sign === -1 ? ", turned round" : ""}`, button]) row.insertCell().append(cell);
      return row;
    }));
  }

  wait(action, row, kind) {
    this.fillDialog();
    const pad = this.controller.pad();
    this.waits = { action, kind, rest: { axes: [...pad.axes], buttons: pad.buttons.map((button) => button.value) } };
    $("actions").rows[Object.keys(ACTIONS).indexOf(action)].cells[1].textContent = kind === "axis" ? `push the stick ${ACTIONS[action].words}` : "press a button";
  }

  listen(pad) {
    const found = this.waits && moved(pad, this.waits.rest, this.waits.kind);
    if (!found) return;
    this.controller.assign(this.waits.action, found);
    this.fillDialog();
  }
}

function bars(list, values, what) {
  while (list.children.length > values.length) list.lastChild.remove();
  values.forEach(({ low, high, on }, at) => {
    const item = list.children[at] ?? list.appendChild(document.createElement("li"));
    if (!item.firstChild) item.append(document.createElement("i"), `${at}`);
    item.title = `${what} ${at}`;
    item.classList.toggle("on", on);
    item.firstChild.style.left = `${50 + 50 * low}%`;
    item.firstChild.style.width = `${50 * (high - low)}%`;
  });
}

function shortName(id) { return id.replace(/\s*\(.*\)/, "").trim() || "Controller"; }
