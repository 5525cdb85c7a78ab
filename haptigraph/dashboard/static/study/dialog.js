/** Ask the experimenter before something is done that cannot be undone. */

const $ = (id) => document.getElementById(id);

/**
 * Ask; null if the answer is no, else the reason (empty where none is asked for).
 *
 * @param {{question: string, consequence: string, sure: string, reason?: boolean}} words
 * @returns {Promise<string | null>}
 */
export function confirmed({ question, consequence, sure, reason = false }) {
  $("question").textContent = question;
  $("consequence").textContent = consequence;
  $("sure").textContent = sure;
  Object.assign($("reason"), { value: "", hidden: !reason, required: reason, placeholder: "Why? It is kept with the data." });
  $("ask").returnValue = "";
  $("ask").showModal();
  (reason ? $("reason") : $("sure")).focus();
  return new Promise((resolve) => {
    $("cancel").onclick = () => $("ask").close();
    $("ask").onclose = () => resolve($("ask").returnValue === "sure" ? $("reason").value : null);
  });
}
