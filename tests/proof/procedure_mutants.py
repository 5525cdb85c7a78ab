"""Mutate every number and order of the shipped procedures once, and explain each mutant that `check` accepts.

`make procedure-mutants` prints the table of docs/explanation/rules.md: mutants of each sort, the share that is refused or
violates a claim, and why the others are accepted.
"""

import re
import sys
import warnings
from collections import Counter
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from broken_procedures import BOUND, blocks

from haptigraph.assemble import load_procedure, procedure_names
from haptigraph.errors import BadInput
from haptigraph.inference.procedure import Procedure
from haptigraph.proof.prove import prove
from haptigraph.proof.rules import rule_cubes
from haptigraph.proof.space import Space

NUMBER = re.compile(r"^(amplitude|frequency_hz|on_ms|off_ms|count|rearm_ms)( = )([\d.]+)", re.MULTILINE)
SLIPS = {"x 1000": (1000.0, ""), "/ 1000": (0.001, ""), "x 57.3": (57.29578, '_deg"')}
"""Factors, and what is in a relation that they are a slip of: degrees for radians is one of angles."""

SAME = "no possible graph has another state"
PLAUSIBLE = "another threshold that an eye allows: only the author knows which is right"
FELT = "another pattern that is felt as what its state means"
ASIDE = "no state depends on it: recorded_only"


class Mutant(NamedTuple):
    """A shipped procedure with one change."""

    sort: str
    what: str
    text: str


def mutants(name: str) -> Iterator[Mutant]:
    """Yield every mutant of a shipped procedure."""
    text = load_procedure(name).text
    yield from _thresholds(text)
    yield from _exchanged(text)
    yield from _patterns(text)
    yield from _orders(text)


def _numbers(text: str, heading: str, number: re.Pattern[str], having: str = "") -> list[re.Match[str]]:
    """Return the numbers in all tables of a heading that have some text, by their place."""
    found, start = [], 0
    for part in blocks(text):
        if part.startswith(heading) and having in part:
            found += [one for one in number.finditer(text, start, start + len(part))]
        start += len(part)
    return found


def _with(text: str, found: re.Match[str], value: float) -> str:
    return f"{text[: found.start(3)]}{value:.10g}{text[found.end(3) :]}"


def _place(text: str, found: re.Match[str]) -> str:
    line = text.count("\n", 0, found.start()) + 1
    return f"line {line}, {found[1]} = {found[3]}"


def _thresholds(text: str) -> Iterator[Mutant]:
    for sort, (factor, having) in SLIPS.items():
        for found in _numbers(text, "[[relation]]", BOUND, having):
            if float(found[3]):
                value = float(found[3]) * factor
                yield Mutant(f"threshold {sort}", _place(text, found), _with(text, found, value))


def _exchanged(text: str) -> Iterator[Mutant]:
    """Exchange the values of two thresholds, and the direction of each."""
    thresholds = _numbers(text, "[[relation]]", BOUND)
    for one, other in combinations(thresholds, 2):
        if float(one[3]) != float(other[3]):
            first = _with(
                text, other, float(one[3])
            )  # the later place first, so that the earlier keeps its own
            what = f"{_place(text, one)} and {_place(text, other)}"
            yield Mutant("two thresholds exchanged", what, _with(first, one, float(other[3])))
    opposite = {"at_most": "above", "above": "at_most", "below": "at_least", "at_least": "below"}
    for found in thresholds:
        if found[1] in opposite:
            turned = f"{text[: found.start(1)]}{opposite[found[1]]}{text[found.end(1) :]}"
            yield Mutant("threshold turned round", _place(text, found), turned)


def _patterns(text: str) -> Iterator[Mutant]:
    for sort, factor in (("x 10", 10.0), ("/ 10", 0.1)):
        for found in _numbers(text, "[[pattern]]", NUMBER):
            value = float(found[3]) * factor
            if found[1] == "count":
                value = round(value)
            if float(found[3]):
                yield Mutant(f"number of a pattern {sort}", _place(text, found), _with(text, found, value))


def _orders(text: str) -> Iterator[Mutant]:
    parts = blocks(text)
    states = [at for at, part in enumerate(parts) if part.startswith("[[state]]")]
    for one, other in combinations(states, 2):
        order = list(parts)
        order[one], order[other] = parts[other], parts[one]
        names = " and ".join(re.search(r'^name = "(\w+)"', parts[at], re.MULTILINE)[1] for at in (one, other))
        yield Mutant("two states swapped", names, "".join(order))


def accepted(mutant: Mutant, folder: Path) -> Procedure | None:
    """Return the procedure if `check` accepts it, else None."""
    file = folder / "mutant.toml"
    file.write_text(mutant.text)
    try:
        procedure = load_procedure(str(file))
    except BadInput:
        return None
    return procedure if prove(procedure).holds else None


def explanation(original: Procedure, mutant: Mutant, procedure: Procedure) -> str:
    """Return why a mutant is accepted; SAME is shown by a look at every possible graph."""
    if mutant.sort == "two states swapped":
        return SAME if _has_same_states(original, procedure) else ""
    if "pattern" in mutant.sort:
        return FELT
    pairs = zip(original.schema.relations, procedure.schema.relations, strict=True)
    return ASIDE if all(one.recorded_only for one, other in pairs if one != other) else PLAUSIBLE


def _has_same_states(one: Procedure, other: Procedure) -> bool:
    space = Space(one.schema)
    rules = [(procedure.states, rule_cubes(procedure, space)) for procedure in (one, other)]

    def state_of(states, cubes, mask: int) -> str:
        return next((state.name for state, cube in zip(states, cubes, strict=True) if cube.matches(mask)), "")

    return all(state_of(*rules[0], world.mask) == state_of(*rules[1], world.mask) for world in space.worlds())


class Outcome(NamedTuple):
    """What became of all mutants."""

    made: Counter[str]
    caught: Counter[str]
    escapes: list[tuple[str, Mutant, str]]
    """Procedure, mutant and explanation."""


def run(names: tuple[str, ...], sorts: tuple[str, ...] = ()) -> Outcome:
    """Check every mutant of some shipped procedures, or those of some sorts."""
    made, caught = Counter[str](), Counter[str]()
    escapes = []
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in names:
            original = load_procedure(name)
            for mutant in mutants(name):
                if sorts and mutant.sort not in sorts:
                    continue
                made[mutant.sort] += 1
                procedure = accepted(mutant, Path(folder))
                if procedure is None:
                    caught[mutant.sort] += 1
                else:
                    escapes.append((name, mutant, explanation(original, mutant, procedure)))
    return Outcome(made, caught, escapes)


def table(outcome: Outcome) -> str:
    """Return the outcome as a Markdown table."""
    lines = ["| mutation | mutants | caught | accepted, because |", "|---|---|---|---|"]
    for sort, count in outcome.made.items():
        why = Counter(reason for _, mutant, reason in outcome.escapes if mutant.sort == sort)
        text = "; ".join(f"{number}: {reason or 'NOT EXPLAINED'}" for reason, number in why.items())
        lines.append(f"| {sort} | {count} | {outcome.caught[sort] / count:.1%} | {text} |")
    total = outcome.made.total()
    lines.append(f"| all | {total} | {outcome.caught.total() / total:.1%} | |")
    return "\n".join(lines)


def main() -> None:
    """Print the table; with --list, every mutant that is accepted."""
    outcome = run(tuple(procedure_names()))
    sys.stdout.write(table(outcome) + "\n")
    if "--list" in sys.argv:
        for name, mutant, reason in outcome.escapes:
            sys.stdout.write(f"{name}: {mutant.sort}: {mutant.what}: {reason}\n")
    sys.exit(any(not reason for _, _, reason in outcome.escapes))


if __name__ == "__main__":
    main()
