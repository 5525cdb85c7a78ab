/** The lists of the experimenter's page: participants, the plan of the current one, notes. */

import { $, make } from "../common/dom.js";

const OUTCOMES = { hit: "target hit", timeout: "target not hit", aborted: "aborted" };

/** @type {Record<string, string>} */
const KINDS = { stop: "session ended: ", felt: "test pulse felt: ", unfelt: "test pulse not felt: " };

/** Show all participants. @param {ExperimenterStatus} status @param {(participant: string, otherStation: string) => void} onOpen called to open one here */
export function showRoster(status, onOpen) {
  const { participants, max_participants, station } = status;
  $("roster").replaceChildren(...participants.map((each) => {
    const isHere = status.current?.participant === each.participant;
    const otherStation = each.station === station ? "" : each.station;
    const action = isHere ? (each.running && !status.trial_status ? "Resume" : "") : otherStation ? "Take over" : each.station ? "Resume" : each.ended ? "View" : each.done ? "Continue" : "Begin";
    const button = make("button", { type: "button", textContent: action, ariaLabel: `${action} ${each.participant}`, disabled: Boolean(status.trial_status) });
    if (action === "Resume") button.className = "primary";
    button.addEventListener("click", () => onOpen(each.participant, otherStation));
    const facts = [each.running && "trial open", each.order.join(", then "), otherStation && `at ${otherStation}`, !each.has_consented && !each.has_left && !status.simulated && "no consent yet", each.void && `${each.void} void`];
    const item = make("li", { className: isHere ? "here" : "" },
      make("b", {}, each.participant), make("span", { className: "quiet" }, `${each.done} of ${each.total}`),
      action ? button : make("span", {}, isHere && "● here"), make("small", {}, each.next),
      make("small", {}, facts.filter(Boolean).join(" · ")));
    item.dataset.participant = each.participant;
    return item;
  }));
  const free = max_participants - participants.filter((each) => !each.has_left).length;
  $("places").textContent = free > 0 ? `${free} of ${max_participants} places free` : `all ${max_participants} places taken`;
}

/** Show the stages of the current participant. @param {CurrentSession | null} current */
export function showPlan(current) {
  $("plan").replaceChildren(...(current?.plan ?? []).map((each, number) => {
    const isNow = number === current?.done && !current.ended;
    const attempts = each.attempts.map(({ attempt, outcome, void: reason }) =>
      `${each.attempts.length > 1 ? `${attempt}: ` : ""}${outcome === null ? "running" : reason === null ? (outcome === "timeout" && each.key.startsWith("training/") ? "ended" : OUTCOMES[outcome]) : `does not count (${reason})`}`);
    const item = make("li", { className: isNow ? "now" : each.is_done ? "done" : "" },
      make("span", { ariaHidden: "true" }, isNow ? "▶" : each.is_done ? "✓" : "·"),
      make("span", {}, each.title), make("span", { className: "quiet" }, isNow && "now"),
      each.condition && make("small", {}, each.condition), attempts.length && make("small", {}, attempts.join(", ")));
    if (isNow) item.setAttribute("aria-current", "step");
    return item;
  }));
  $("plan").querySelector(".now")?.scrollIntoView({ block: "nearest" });
}

/** Show the notes about the current participant, the newest last. @param {CurrentSession | null} current */
export function showNotes(current) {
  const before = $("notes").children.length;
  $("notes").replaceChildren(...(current?.events ?? []).map(({ kind, text, at_utc }) => make("li", {},
    make("time", { dateTime: at_utc }, new Date(at_utc).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" })),
    KINDS[kind] && make("strong", {}, KINDS[kind]), text)));
  if ($("notes").children.length !== before) $("notes").lastElementChild?.scrollIntoView({ block: "nearest" });
  for (const element of [$("note-text"), $("note-save")]) element.disabled = !current;
}
