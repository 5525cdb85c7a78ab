/** The lists of the experimenter's page: participants, the plan of the one who is here, notes. */

const make = (name, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(name), properties);
  element.append(...children.filter(Boolean));
  return element;
};
const $ = (id) => document.getElementById(id);
const OUTCOMES = { hit: "target hit", timeout: "target not hit", aborted: "aborted" };

/** Show everyone; `onOpen(participant, station)` is called to bring one here. */
export function showRoster(now, onOpen) {
  $("roster").replaceChildren(...now.participants.map((each) => {
    const isHere = now.here?.participant === each.participant;
    const elsewhere = each.station && each.station !== now.station;
    const words = isHere ? (each.running && !now.doing ? "Resume" : "") : elsewhere ? "Take over" : each.station ? "Resume" : each.ended ? "Look" : each.done ? "Go on" : "Begin";
    const button = words && make("button", { type: "button", textContent: words, ariaLabel: `${words} ${each.participant}`, disabled: Boolean(now.doing) });
    if (button) {
      if (words === "Resume") button.className = "primary";
      button.addEventListener("click", () => onOpen(each.participant, elsewhere ? each.station : ""));
    }
    const facts = [each.running && "trial open", each.order.join(", then "), elsewhere && `at ${each.station}`, each.void && `${each.void} void`];
    const item = make("li", { className: isHere ? "here" : "" },
      make("b", {}, each.participant), make("span", { className: "quiet" }, `${each.done} of ${each.of}`),
      button || make("span", {}, isHere ? "● here" : ""), make("small", {}, each.next),
      make("small", {}, facts.filter(Boolean).join(" · ")));
    item.dataset.participant = each.participant;
    return item;
  }));
  const free = now.most - now.participants.filter((each) => !each.left).length;
  $("room").textContent = free > 0 ? `${free} of ${now.most} places free` : `all ${now.most} places taken`;
}

/** Show what the participant who is here has done and what comes. */
export function showPlan(here) {
  $("plan").replaceChildren(...(here?.plan ?? []).map((each, number) => {
    const isNow = number === here.done && !here.ended;
    const attempts = each.attempts.map(({ attempt, outcome, void: why }) =>
      `${each.attempts.length > 1 ? `${attempt}: ` : ""}${outcome === null ? "runs" : why === null ? OUTCOMES[outcome] : `does not count (${why})`}`);
    const item = make("li", { className: isNow ? "now" : each.is_behind ? "behind" : "" },
      make("span", { ariaHidden: "true" }, isNow ? "▶" : each.is_behind ? "✓" : "·"),
      make("span", {}, each.title), make("span", { className: "quiet" }, isNow ? "now" : ""),
      each.condition && make("small", {}, each.condition), attempts.length && make("small", {}, attempts.join(", ")));
    if (isNow) item.setAttribute("aria-current", "step");
    return item;
  }));
  $("plan").querySelector(".now")?.scrollIntoView({ block: "nearest" });
}

/** Show what was noted of the participant who is here, the newest last. */
export function showNotes(here) {
  const before = $("notes").children.length;
  $("notes").replaceChildren(...(here?.events ?? []).map(({ kind, text, at_utc }) => make("li", {},
    make("time", { dateTime: at_utc }, new Date(at_utc).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" })),
    kind === "stop" && make("strong", {}, "session ended: "), text)));
  if ($("notes").children.length !== before) $("notes").lastElementChild?.scrollIntoView({ block: "nearest" });
  for (const element of $("note").elements) element.disabled = !here;
}
