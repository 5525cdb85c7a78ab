"""Generate sound procedures, and mutate each so that a certain claim must fail.

A sound procedure partitions two measures, A and B, into cells. Its rules, in order of priority: no needle; the first
cell of A (alarm); the second of A with the first of B (narrow) before the second of A alone (broad); the second of
B for any A (guidance); every other cell of A, alone or split over all of B. So the narrow rule must precede the
broad one, the alarm overlaps the guidance, and without guidance every cell of A is still covered. For each rule, an
invariant states its pattern where it matches and one edge of every earlier rule is absent.

No mutant is equivalent: a mutation changes only what matters in this construction, and its docstring gives the reason.
"""

import json
import random
import warnings
from collections.abc import Callable, Iterable
from copy import deepcopy
from typing import Any, NamedTuple

from haptigraph.assemble import parse_procedure
from haptigraph.errors import Implausible
from haptigraph.inference.procedure import Procedure

ENTITIES = [
    {"name": "needle_tip", "group": "instrument", "geometry": "point", "label": "tip"},
    {"name": "needle_line", "group": "instrument", "geometry": "segment", "visible_with": "needle_tip"},
    {"name": "retina_surface", "group": "anatomy", "geometry": "polyline", "label": "retina", "fixed": True},
    {"name": "retina_target", "group": "anatomy", "geometry": "point", "label": "target", "fixed": True},
    {"name": "eye_globe", "group": "anatomy", "geometry": "circle", "fixed": True},
    {"name": "trocar", "group": "anatomy", "geometry": "point", "fixed": True},
]
MEASURED = [
    ("needle_tip", "retina_surface", "distance_mm", "distance_to_retina_mm", -1.0, 8.0),
    ("needle_tip", "retina_target", "distance_mm", "distance_to_target_mm", 0.5, 9.0),
    ("needle_line", "retina_target", "theta_deg", "theta_deg", 1.0, 60.0),
    ("needle_tip", "eye_globe", "wall_mm", "wall_mm", -1.0, 6.0),
]

Data = dict[str, Any]


class Made(NamedTuple):
    """A sound procedure as data, and the names of its relations."""

    data: Data
    a: list[list[str]]
    """The relations that partition measure A, in order."""
    b: list[list[str]]


class Mutant(NamedTuple):
    """A mutated procedure, and claims of which at least one must fail."""

    procedure: Procedure
    claims: tuple[str, ...]


def load(data: Data) -> Procedure:
    text = "".join(_table(kind, part) for kind, parts in data.items() for part in parts)
    with warnings.catch_warnings(action="ignore", category=Implausible):  # no eye has these thresholds
        return parse_procedure(f'[procedure]\nname = "made"\n{text}', "made.toml")


def _table(kind: str, part: Data) -> str:
    lines = (f"{key} = {json.dumps(value)}" for key, value in part.items() if value is not None)
    return f"\n[[{kind}]]\n" + "\n".join(lines) + "\n"


def sound(seed: int) -> Made:
    rng = random.Random(seed)
    first, second = rng.sample(MEASURED, 2)
    a, a_relations = _partition(rng, "a", first, rng.randint(3, 4))
    b, b_relations = _partition(rng, "b", second, rng.randint(2, 3))
    overlaps = _released(rng, a_relations) if rng.random() < 0.5 else []
    states: list[Data] = [
        {"name": "alarm", "when": [a[0]], "feel": "pulse"},
        {"name": "narrow", "when": [a[1], b[0]], "feel": "low"},
        {"name": "broad", "when": [a[1]], "feel": "off"},
    ]
    if rng.random() < 0.7:
        states.append({"name": "guidance", "when": [b[1]], "feel": "tick"})
    else:
        states[2]["feel"] = "tick"
    for number, cell in enumerate(a[2:]):
        if (
            rng.random() < 0.5 or len(states) > 3
        ):  # after guidance, one rule a cell: a split might be shadowed
            states.append({"name": f"rest{number}", "when": [cell], "feel": "off"})
        else:
            states += [
                {"name": f"rest{number}_{at}", "when": [cell, other], "feel": "low" if at else "off"}
                for at, other in enumerate(b)
            ]
    used = [names for state in states for names in state["when"]]
    for relation in (*a_relations, *b_relations):
        relation["recorded_only"] = _names(relation) not in used
    named = {"needle_tip", *(names[at] for names in (*a, *b) for at in (0, 2))}
    if {first[3], second[3]} & {"distance_to_retina_mm", "theta_deg"}:
        named.add("trocar")
    data: Data = {
        "entity": [deepcopy(entity) for entity in ENTITIES if entity["name"] in named],
        "relation": [*a_relations, *b_relations],
        "overlap": overlaps,
        "state": [
            {"name": "unknown", "absent": ["needle_tip"], "feel": "off", "because": "no needle"},
            *({**state, "because": state["name"]} for state in states),
        ],
        "pattern": [
            {"name": "off", "kind": "off"},
            {"name": "low", "kind": "continuous", "amplitude": 0.3},
            {"name": "tick", "kind": "continuous", "amplitude": 0.1},
            {"name": "pulse", "kind": "pulses", "amplitude": 1.0, "on_ms": 80, "off_ms": 80},
        ],
        "invariant": [
            {"name": "silent without needle", "absent": ["needle_tip"], "feels": ["off"]},
            *_invariants(states),
        ],
    }
    return Made(data, a, b)


def _partition(
    rng: random.Random, letter: str, measured: tuple[Any, ...], count: int
) -> tuple[list[Any], list[Data]]:
    subject, object_, measure, _, low, high = measured
    width = (high - low) / count
    cuts = [round(low + width * (at + rng.uniform(0.6, 1.0)), 2) for at in range(count - 1)]
    upper, lower = rng.choice([("at_most", "above"), ("below", "at_least")])
    names, relations = [], []
    for at in range(count):
        names.append([subject, f"{letter}{at}", object_])
        relation: Data = {
            "subject": subject,
            "predicate": f"{letter}{at}",
            "object": object_,
            "measure": measure,
        }
        if at > 0:
            relation[lower] = cuts[at - 1]
        if at < count - 1:
            relation[upper] = cuts[at]
        relations.append(relation)
    return names, relations


def _released(rng: random.Random, relations: list[Data]) -> list[Data]:
    """Extend the first relation into the second by a release, and declare the overlap."""
    first, second = relations[0], relations[1]
    first["release"] = round(
        _bound(first, "upper") + 0.3 * (_bound(second, "upper") - _bound(first, "upper")), 3
    )
    return [{"relations": [_names(first), _names(second)], "because": "the alarm continues for a while"}]


def _names(relation: Data) -> list[str]:
    return [relation["subject"], relation["predicate"], relation["object"]]


def _key(relation: Data, side: str) -> str:
    keys = ("at_most", "below") if side == "upper" else ("above", "at_least")
    return next(key for key in keys if key in relation)


def _bound(relation: Data, side: str) -> float:
    return relation[_key(relation, side)]


def _invariants(states: Iterable[Data]) -> list[Data]:
    """For every rule: where it matches and every earlier one lacks an edge, it decides."""
    made: list[Data] = []
    earlier: list[Data] = []
    for state in states:
        unless = []
        for other in earlier:
            missing = [names for names in other["when"] if names not in state["when"]]
            if missing and not any(names in unless for names in missing):
                unless.append(missing[0])
        made.append(
            {
                "name": f"{state['name']} decides",
                "when": state["when"],
                "unless": unless,
                "states": [state["name"]],
                "feels": [state["feel"]],
            }
        )
        earlier.append(state)
    return made


def _state(data: Data, name: str) -> Data:
    return next(state for state in data["state"] if state["name"] == name)


def _swap(data: Data, one: str, other: str) -> None:
    at = {state["name"]: number for number, state in enumerate(data["state"])}
    states = data["state"]
    states[at[one]], states[at[other]] = states[at[other]], states[at[one]]


def _new_state(name: str, when: list[Any], **more: Any) -> Data:
    return {"name": name, "when": when, "feel": "off", "because": name, **more}


Mutation = Callable[[random.Random, Made, Data], tuple[str, ...]]


def narrow_after_broad(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """The broad rule matches wherever the narrow one does, so the narrow one is shadowed."""
    _swap(data, "narrow", "broad")
    return ("reachable",)


def alarm_after_guidance(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """With A in its first cell and B in its second, both match; the invariant of the alarm ignores B."""
    if not any(state["name"] == "guidance" for state in data["state"]):
        data["state"].insert(1, _new_state("urge", [made.b[1]], feel="low"))
    else:
        _swap(data, "alarm", "guidance")
    return ("invariant",)


def copy_of_a_rule(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """A rule that requires more than an earlier one can never be the first match."""
    data["state"].append(_new_state("again", [made.a[0], rng.choice(made.b)]))
    return ("reachable",)


def rule_for_two_cells(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """The first and the last cell of A never hold at once: at least one whole cell is between them."""
    data["state"].insert(1, _new_state("both", [made.a[0], made.a[-1]]))
    return ("reachable",)


def catch_all_first(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """A rule without a condition matches every graph."""
    data["state"].insert(rng.randrange(1, len(data["state"])), _new_state("always", []))
    return ("reachable",)


def gap_between(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """Between the end of one cell of B and the raised beginning of the next, neither holds."""
    count = len(made.a)
    at = rng.randrange(1, len(made.b))
    relation, before = data["relation"][count + at], data["relation"][count + at - 1]
    key = _key(relation, "lower")
    relation[key] = round(_bound(before, "upper") + 0.05 * rng.randint(1, 4), 3)
    return ("gapless",)


def gap_at_the_end(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """The last cell of A had no end."""
    last = data["relation"][len(made.a) - 1]
    last["at_most"] = round(_bound(last, "lower") + rng.uniform(0.5, 3.0), 2)
    return ("gapless",)


def overlap(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """Two cells of B share values; no [[overlap]] is declared for B."""
    count = len(made.a)
    relation = data["relation"][count + rng.randrange(1, len(made.b))]
    relation[_key(relation, "lower")] -= 0.05 * rng.randint(1, 4)
    return ("exclusive",)


def undeclared_release(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """With a release, one cell of B extends into the next."""
    relation = data["relation"][len(made.a)]
    relation["release"] = round(_bound(relation, "upper") + rng.uniform(0.05, 0.3), 3)
    return ("exclusive",)


def needless_overlap(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """The first and the last cell of A share no value."""
    data["overlap"].append({"relations": [made.a[0], made.a[-1]], "because": "by mistake"})
    return ("exclusive",)


def needless_gap(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """The last cell of A has no end, so no value is left out."""
    relation = data["relation"][len(made.a) - 1]
    name = next(
        row[3] for row in MEASURED if row[:3] == tuple(relation[k] for k in ("subject", "object", "measure"))
    )
    data["gap"] = [{"measure": name, "above": _bound(relation, "lower") + 1.0, "because": "by mistake"}]
    return ("gapless",)


def other_pattern(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """The invariant of every state fixes its pattern, and its premise is satisfiable."""
    state = rng.choice(data["state"][1:])
    state["feel"] = rng.choice([feel for feel in ("off", "low", "tick", "pulse") if feel != state["feel"]])
    return ("invariant",)


def no_alarm(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """Without its rule, the first cell of A has another state and another pattern than its invariant requires."""
    data["state"] = [state for state in data["state"] if state["name"] != "alarm"]
    invariant = next(one for one in data["invariant"] if one["name"] == "alarm decides")
    del invariant["states"]
    return ("invariant", "total")


def no_last_cell(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """In the last cell of A with the first of B, only its own rule matches."""
    data["state"] = [state for state in data["state"] if made.a[-1] not in state.get("when", [])]
    data["invariant"] = []
    return ("total",)


def one_more_exception(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """No rule matches what the rule of the last cell now excludes, the first cell of B."""
    for state in data["state"]:
        if made.a[-1] in state.get("when", []) and made.b[0] not in state["when"]:
            state["unless"] = [made.b[0]]
        elif made.a[-1] in state.get("when", []):
            data["state"].remove(state)
            break
    data["invariant"] = []
    return ("total",)


def anatomy_may_be_absent(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """Without the objects of A and B, a detected needle has no state."""
    for names in (made.a[0], made.b[0]):
        next(entity for entity in data["entity"] if entity["name"] == names[2])["fixed"] = False
    return ("total",)


def contradicting_invariant(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """The pattern of the first cell of A is the alarm, which this invariant excludes."""
    data["invariant"].append({"name": "never", "when": [made.a[0]], "never_feels": ["pulse"]})
    return ("invariant",)


def vacuous_invariant(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """No possible graph satisfies the premise."""
    data["invariant"].append({"name": "empty", "when": [made.a[0], made.a[-1]], "feels": ["pulse"]})
    return ("invariant",)


def unused_pattern(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """No state uses a pattern that was just added."""
    data["pattern"].append({"name": "spare", "kind": "continuous", "amplitude": 0.5})
    return ("used",)


def _add_radial(data: Data, **bounds: Any) -> None:
    declared = [entity["name"] for entity in data["entity"]]
    required = ("retina_target", "trocar")
    data["entity"] += [
        one for one in deepcopy(ENTITIES) if one["name"] in required and one["name"] not in declared
    ]
    names = {
        "subject": "needle_tip",
        "predicate": "beside",
        "object": "retina_target",
        "measure": "radial_mm",
    }
    data["relation"].append({**names, **bounds})


def unused_relation(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """No rule uses a relation that was just added."""
    _add_radial(data, at_most=round(rng.uniform(0.3, 3.0), 2))
    return ("used",)


def used_though_recorded_only(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """The alarm uses the first cell of A."""
    data["relation"][0]["recorded_only"] = True
    return ("used",)


def unused_entity(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """Nothing uses an entity that was just added."""
    data["entity"].append({"name": "forceps", "group": "instrument", "geometry": "point"})
    return ("used",)


def relation_below_zero(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """No distance is negative."""
    _add_radial(data, at_most=-rng.uniform(0.1, 2.0), recorded_only=True)
    return ("possible",)


def relation_given_its_opposite(rng: random.Random, made: Made, data: Data) -> tuple[str, ...]:
    """The first and the last cell of A never hold at once, so nothing is given both."""
    _add_radial(data, at_most=1.0, given=[made.a[0], made.a[-1]], recorded_only=True)
    return ("possible",)


MUTATIONS: list[Mutation] = [
    narrow_after_broad, alarm_after_guidance, copy_of_a_rule, rule_for_two_cells, catch_all_first, gap_between,
    gap_at_the_end, overlap, undeclared_release, needless_overlap, needless_gap, other_pattern, no_alarm,
    no_last_cell, one_more_exception, anatomy_may_be_absent, contradicting_invariant, vacuous_invariant,
    unused_pattern, unused_relation, used_though_recorded_only, unused_entity, relation_below_zero,
    relation_given_its_opposite,
]  # fmt: skip


def mutate(mutation: Mutation, seed: int) -> Mutant:
    made = sound(seed)
    data = deepcopy(made.data)
    claims = mutation(random.Random(seed), made, data)
    return Mutant(load(data), claims)
