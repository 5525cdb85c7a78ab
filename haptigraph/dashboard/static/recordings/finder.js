/** Finds recordings in the archive: a form, and links to the recordings and moments that it selects. */

import { $, make } from "../common/dom.js";
import { date } from "./run_list.js";
import { isAbort, messages } from "./stream.js";

/** The request that runs. @type {AbortController | null} */ let finding = null;

/** Begin to answer the form. @param {(error: unknown) => void} onProblem */
export function beginFinder(onProblem) {
  $("find-form").addEventListener("submit", (event) => {
    event.preventDefault();
    find().catch((error) => { if (!isAbort(error)) onProblem(error); });
  });
}

async function find() {
  finding?.abort();
  finding = new AbortController();
  $("found-count").textContent = "…";
  $("found").replaceChildren();
  try {
    for await (const [content] of messages("/recordings/find", { filter: JSON.stringify(fields()) }, finding.signal)) {
      if (content.type === "found") show(content);
    }
  } finally {
    if ($("found-count").textContent === "…") $("found-count").textContent = "";
  }
}

/** The form's fields, as the server's Filter. */
function fields() {
  const form = new FormData($("find-form"));
  const text = (/** @type {string} */ name) => String(form.get(name) ?? "").trim();
  const [measures, ways, values] = ["measure", "way", "value"].map((name) => form.getAll(name).map((value) => String(value).trim()));
  const conditions = measures.map((measure, at) => ({ measure, way: ways[at], value: Number(values[at]) })).filter((each, at) => each.measure && values[at]);
  return {
    ...Object.fromEntries(["since", "until", "procedure", "participant", "outcome", "state"].map((name) => [name, text(name)])),
    has_alarm: form.has("has_alarm"), has_fault: form.has("has_fault"), conditions,
  };
}

function show(/** @type {Found} */ { rows, is_complete, note }) {
  const count = `${rows.length}${is_complete ? "" : " newest of more"} recordings`;
  $("found-count").textContent = note ? `${count}; ${note}` : count;
  $("found").replaceChildren(...rows.map((row) => {
    const step = row.first_step === null ? "" : `?step=${row.first_step}`;
    const link = make("a", { href: `#${encodeURIComponent(row.recording)}${step}`, textContent: row.recording });
    const cells = [date(row.started_utc ?? ""), row.procedure, row.participant, row.problem || row.outcome, step && `step ${row.first_step}`];
    return make("tr", {}, make("td", {}, link), ...cells.map((textContent) => make("td", { textContent: textContent ?? "" })));
  }));
}
