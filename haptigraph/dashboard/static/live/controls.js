/** The panel of the controls: who has them, how hand motion becomes tool motion, and the controller's input. */

import { ACTIONS, movedInput } from "./gamepad.js";
import { $, checkbox, make } from "../common/dom.js";
import { controllerText } from "./rumble.js";

const TREMOR_MM = 1.0;

export class Controls {
  me = ""; holder = ""; maySteer = true;
  /** @type {TeleopSettings | null} */ settings = null;
  /** The action that gets the input that moves next. @type {{ action: Action, kind: ActionInfo["kind"], rest: PadValues } | null} */
  pending = null;

  /** @param {Send} send @param {import("./steering.js").Steering} steering @param {import("./gamepad.js").Controller} controller */
  constructor(send, steering, controller) {
    this.send = send; this.steering = steering; this.controller = controller;
    $("hold").addEventListener("click", () => send({ type: this.holder === this.me ? "release_controls" : "take_controls" }));
    $("scale").addEventListener("input", () => this.tune({ motion_scale: Number($("scale").value) }));
    $("scale").addEventListener("pointerup", () => $("scale").blur());  // so that the arrow keys steer again
    $("filter").addEventListener("change", () => this.tune({ tremor_filter: $("filter").checked }));
    $("tremor").addEventListener("change", () => this.tune({ added_tremor_mm: $("tremor").checked ? TREMOR_MM : 0 }));
    this.needsClutch = checkbox("Needs clutch", false, (isOn) => { steering.needsClutch = isOn; }, "needs-clutch");
    $("switches").append(this.needsClutch);
    $("map").addEventListener("click", () => { this.fillDialog(); $("mapping").showModal(); });
    $("standard").addEventListener("click", () => { controller.reset(); this.fillDialog(); });
    steering.onFilter = () => this.tune({ tremor_filter: !this.settings?.tremor_filter });
  }

  begin(/** @type {Hello} */ hello) {
    const { has_jaws = false, robot = "" } = hello, steerable = this.maySteer && (hello.steerable ?? false);
    this.steering.begin(hello);
    $("steering").hidden = !steerable;
    $("jaws").hidden = !has_jaws;
    $("depth").hidden = robot === "";
    for (const box of [$("tremor").parentElement, this.needsClutch]) if (box) box.hidden = robot !== "";
    document.querySelector("main")?.classList.toggle("steerable", steerable);
    if (steerable && !document.hidden) this.send({ type: "take_controls" });
  }

  tune(/** @type {Partial<TeleopSettings>} */ change) { this.send({ type: "tune", ...change }); }

  showSettings(/** @type {TeleopSettings} */ settings) {
    this.settings = settings;
    if (document.activeElement !== $("scale")) $("scale").value = String(settings.motion_scale);
    $("scale-value").textContent = `× ${settings.motion_scale.toFixed(2)}`;
    $("filter").checked = settings.tremor_filter;
    $("tremor").checked = settings.added_tremor_mm > 0;
  }

  showHolder(/** @type {string} */ holder) {
    const isMine = holder !== "" && holder === this.me;
    this.holder = holder;
    if (this.steering.isHolder && !isMine) this.steering.release();
    this.steering.isHolder = isMine;
    $("holder").textContent = isMine ? "You have the controls" : holder ? `${holder} has the controls` : "Nobody has the controls";
    $("hold").textContent = isMine ? "Release" : "Take";
    $("hold").disabled = holder !== "" && !isMine;
    $("hold").classList.toggle("primary", holder === "");
    for (const input of [$("scale"), $("filter"), $("tremor")]) input.disabled = !isMine;
  }

  /** Show the present input; called with every drawing. */
  show() {
    const pad = this.controller.pad();
    const { engaged } = this.steering;
    const engagedText = this.steering.isRobot ? "● dead-man held" : "● moving the instrument";
    $("clutch").textContent = engaged ? engagedText : "○ disengaged";
    $("clutch").classList.toggle("on", engaged);
    $("pad").textContent = controllerText(pad);
    $("map").hidden = !pad;
    if (!$("mapping").open) return;
    if (!pad) { $("mapping").close(); return; }
    showBars($("axes"), pad.axes.map((value) => ({ low: Math.min(value, 0), high: Math.max(value, 0), isOn: Math.abs(value) > 0.35 })), "axis");
    showBars($("buttons"), pad.buttons.map((button) => ({ low: 0, high: button.value, isOn: button.pressed })), "button");
    const input = this.pending && movedInput(pad, this.pending.rest, this.pending.kind);
    if (!input || !this.pending) return;
    this.controller.assign(this.pending.action, input);
    this.fillDialog();
  }

  fillDialog() {
    const actions = /** @type {[Action, ActionInfo][]} */ (Object.entries(ACTIONS)).filter(([, { needsJaws, needsRobot }]) => (!needsJaws || this.steering.hasJaws) && (!needsRobot || this.steering.isRobot));
    this.pending = null;
    $("actions").replaceChildren(...actions.map(([action, { label, kind }]) => {
      const { index, sign } = this.controller.mapping[action];
      const button = make("button", { type: "button", textContent: "Change", ariaLabel: `Change ${label}` });
      const mapped = make("td", {}, `${kind} ${index}${sign === -1 ? ", inverted" : ""}`);
      button.addEventListener("click", () => this.listen(action));
      return make("tr", { id: `map-${action}` }, make("td", {}, label), mapped, make("td", {}, button));
    }));
  }

  /** Map the input that moves next to an action. @param {Action} action */
  listen(action) {
    const pad = this.controller.pad(), { kind, label } = ACTIONS[action];
    this.fillDialog();
    if (!pad) return;
    this.pending = { action, kind, rest: { axes: [...pad.axes], buttons: pad.buttons.map((button) => button.value) } };
    const row = /** @type {HTMLTableRowElement} */ (document.getElementById(`map-${action}`));
    row.cells[1].textContent = kind === "axis" ? `push the stick ${label}` : "press a button";
  }
}

/** @param {HTMLElement} list @param {{ low: number, high: number, isOn: boolean }[]} values @param {string} what */
function showBars(list, values, what) {
  while (list.children.length > values.length) list.lastChild?.remove();
  values.forEach(({ low, high, isOn }, at) => {
    const item = list.children[at] ?? list.appendChild(make("li", { title: `${what} ${at}` }, make("i"), `${at}`));
    item.classList.toggle("on", isOn);
    const { style } = /** @type {HTMLElement} */ (item.firstChild);
    style.left = `${50 + 50 * low}%`;
    style.width = `${50 * (high - low)}%`;
  });
}
