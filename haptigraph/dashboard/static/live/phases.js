/** The phases of the operation: which one it is, and buttons (and the keys 1 to 9) to enter another. */

export class Phases {
  /**
   * @param {HTMLElement} root
   * @param {(message: any) => void} send
   */
  constructor(root, send) {
    Object.assign(this, { root, send, buttons: new Map() });
    document.addEventListener("keydown", (event) => {
      const typing = event.target instanceof Element && event.target.closest("input, select, dialog");
      if (!typing && !event.ctrlKey && !event.altKey && !event.metaKey) [...this.buttons.values()][Number(event.key) - 1]?.click();
    });
  }

  begin({ procedure }) {
    const names = procedure.entities.filter((entity) => entity.geometry === "phase").map((entity) => entity.name);
    this.buttons = new Map(names.map((name, at) => [name, this.button(name, at + 1)]));
    this.root.hidden = !names.length;
    this.root.replaceChildren(this.root.querySelector("legend"), ...this.buttons.values());
  }

  button(name, key) {
    const button = document.createElement("button");
    Object.assign(button, { type: "button", textContent: name.replaceAll("_", " "), title: `Key ${key}` });
    button.addEventListener("click", () => this.send({ type: "enter", phase: name }));
    return button;
  }

  show(header) {
    for (const [name, button] of this.buttons) {
      const isOn = header.nodes.includes(name);
      button.setAttribute("aria-pressed", isOn);
      button.classList.toggle("primary", isOn);
    }
  }

  /** Let this page enter phases, or not: another one holds the controls. */
  allow(may) { this.root.disabled = !may; }
}
