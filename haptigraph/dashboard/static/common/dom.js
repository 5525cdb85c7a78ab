/** Helpers for HTML and SVG elements. */

const SVG = "http://www.w3.org/2000/svg";

/** Return the element of an id. @type {<K extends keyof PageElements>(id: K) => PageElements[K]} */
export const $ = (id) => /** @type {any} */ (document.getElementById(id));

/** Create an HTML element; children that are null, false, 0 or empty are left out.
 *  @template {keyof HTMLElementTagNameMap} K
 *  @param {K} tag @param {Partial<HTMLElementTagNameMap[K]>} [properties]
 *  @param {(Node | string | number | false | null | undefined)[]} children */
export function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  Object.assign(element, properties).append(.../** @type {(Node | string)[]} */ (children.filter(Boolean)));
  return element;
}

/** Create an SVG element.
 *  @template {keyof SVGElementTagNameMap} K
 *  @param {K} tag @param {Record<string, string | number>} [attributes] @param {(Node | string)[]} children */
export function svg(tag, attributes = {}, ...children) {
  /** @type {SVGElementTagNameMap[K]} */ const element = document.createElementNS(SVG, tag);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
  element.append(...children);
  return element;
}

/** Set a text if it changes, so that screen readers do not repeat it. @param {Element} element @param {string} text */
export function setText(element, text) { if (element.textContent !== text) element.textContent = text; }

/** Show a text, or hide its element if there is none. @param {HTMLElement} element @param {string} text */
export function showOrHide(element, text) { element.textContent = text; element.hidden = !text; }

/** Create a checkbox with a label; the browser remembers its value if a storage key is given.
 *  @param {string} text @param {boolean} checked @param {(isOn: boolean) => void} onChange @param {string} [key] */
export function checkbox(text, checked, onChange, key = "") {
  const box = make("input", { type: "checkbox" }), stored = key && localStorage.getItem(key);
  box.checked = stored ? stored === "1" : checked;
  box.addEventListener("change", () => {
    if (key) localStorage.setItem(key, box.checked ? "1" : "0");
    onChange(box.checked);
  });
  onChange(box.checked);
  return make("label", {}, box, text);
}
