"""Two runs of the same images as a table in plain text: measures, times of states, patterns, claims."""

from collections.abc import Callable, Iterator
from pathlib import Path

from haptigraph.analysis.metrics.replay import ReplayReport
from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.analysis.metrics.temporal import ClaimResult

__all__ = ["comparison", "identical_line"]

Line = tuple[str, str, str]
NONE = "-"


def comparison(report: ReplayReport, procedure: str) -> str:
    """Return the table; an asterisk marks what differs.

    Args:
        report: Of a replay.
        procedure: Name or file of the procedure that was applied.
    """
    head = ("", "recorded", Path(procedure).name.removesuffix(".toml"))
    table = [head, *_lines(report)]
    widths = [max(len(line[column]) for line in table) for column in range(3)]
    return "\n".join(_line(line, widths) for line in table)


def identical_line(identical: int, steps: int) -> str:
    """Return how many steps are identical to the last bit, and what that says of the others."""
    line = f"{identical} of {steps} steps identical"
    return line if identical == steps else f"{line}; the others differ at least in a relation or a number"


def _lines(report: ReplayReport) -> Iterator[Line]:
    runs = report.recorded, report.replayed
    yield "completion time", *_both(runs, _completion)
    yield "mean theta", *_both(runs, lambda run: _number(run.mean_theta_deg, "°"))
    yield "unintended contacts", *_both(runs, lambda run: str(run.contacts))
    yield "state changes", *_both(runs, lambda run: str(run.state_changes))
    yield "steps without a visible tip", *_both(runs, lambda run: str(run.tipless_steps))
    states = dict.fromkeys([*runs[0].all_state_s, *runs[1].all_state_s])
    for state in sorted(states, key=lambda name: -runs[0].all_state_s.get(name, 0.0)):
        times = (f"{run.all_state_s.get(state, 0.0):.2f} s" for run in runs)
        yield f"state {state.replace('_', ' ')}", *times  # type: ignore[misc]
    patterns = report.recorded_patterns, report.replayed_patterns
    for name in dict.fromkeys([*patterns[0], *patterns[1]]):
        yield f"pattern {name}", *(f"{each[name]} steps" for each in patterns)  # type: ignore[misc]
    claims = [{claim.name: claim for claim in run.claims} for run in runs]
    for name in dict.fromkeys([*claims[0], *claims[1]]):
        first, second = (_claim(each.get(name)) for each in claims)
        yield f"claim {name}", first, second


def _both(runs: tuple[RunMeasures, RunMeasures], text: Callable[[RunMeasures], str]) -> tuple[str, str]:
    return text(runs[0]), text(runs[1])


def _completion(run: RunMeasures) -> str:
    return "no run" if run.started_ns is None else _number(run.completion_s, " s")


def _number(value: float | None, unit: str) -> str:
    return NONE if value is None else f"{value:.2f}{unit}"


def _claim(result: ClaimResult | None) -> str:
    """Return how a claim held; one that was not exercised is not kept."""
    if result is None:
        return NONE
    if result.broken:
        return f"broken {result.broken} times"
    return "kept" if result.cases else "not exercised"


def _line(cells: Line, widths: list[int]) -> str:
    name, first, second = (cell.ljust(width) for cell, width in zip(cells, widths, strict=True))
    is_different = cells[0] and cells[1] != cells[2]
    return f"{name}  {first}  {second}{'  *' if is_different else ''}".rstrip()
