/** Ask the experimenter to confirm an action that cannot be undone. */

import { $ } from "../common/dom.js";

/** Ask; null if the answer is no, else the reason (empty if none is needed).
 *  @param {{question: string, consequence: string, confirm: string, needsReason?: boolean}} texts
 *  @returns {Promise<string | null>} */
export function confirmed({ question, consequence, confirm, needsReason = false }) {
  $("question").textContent = question;
  $("consequence").textContent = consequence;
  $("confirm").textContent = confirm;
  Object.assign($("reason"), { value: "", hidden: !needsReason, required: needsReason, placeholder: "Reason; it is saved with the data" });
  $("ask").returnValue = "";
  $("ask").showModal();
  (needsReason ? $("reason") : $("confirm")).focus();
  return new Promise((resolve) => {
    $("cancel").onclick = () => $("ask").close();
    $("ask").onclose = () => resolve($("ask").returnValue === "confirm" ? $("reason").value : null);
  });
}
