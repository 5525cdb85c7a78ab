"""Summary of a run in plain text: the surgeon's measures, and the performance of the loop."""

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.analysis.metrics.temporal import claim_lines
from haptigraph.graph import Triplet
from haptigraph.registration.assumed import assumed_lines
from haptigraph.run_report import STAGES, RunReport

__all__ = ["summary"]

MIN_SLIPPED = 0.02
"""Of a run's time; less is not worth a line."""


def summary(measures: RunMeasures, report: RunReport | None = None) -> str:
    """Return the summary, several lines of text.

    Args:
        measures: Measures of the run.
        report: Report of the loop, if there was one.
    """
    lines = [*_run_lines(measures), *assumed_lines(report.assumed if report else ()), *_tip_lines(measures)]
    lines += measures.in_space.lines
    lines += _vibration_lines(measures, report)
    if report and report.is_output_off:
        lines.append("haptic output   off: claims are about what was commanded")
    lines += [*claim_lines(measures.claims, measures.first_ns), ""]
    lines += [f"{'state':36}{'in run':>9}{'in all':>9}"]
    for state, seconds in sorted(measures.all_state_s.items(), key=lambda item: -item[1]):
        lines.append(f"{state:36}{measures.state_s.get(state, 0.0):7.2f} s{seconds:7.2f} s")
    if report is not None:
        lines += ["", *_loop_lines(report)]
    return "\n".join(lines)


def _run_lines(measures: RunMeasures) -> list[str]:
    begins, goal = Triplet(*measures.span.begins), measures.span.ends_in.replace("_", " ")
    if not measures.has_start:
        return [
            f"run             none: the procedure has no {begins}; define the start of a run in its [run]"
        ]
    if measures.started_ns is None:
        return [f"run             none: {begins} never occurred"]
    completion_s, theta_deg = measures.completion_s, measures.mean_theta_deg
    outcome = f"no {goal}" if completion_s is None else f"{goal} after {completion_s:.2f} s"
    return [
        f"run             {outcome}",
        f"mean theta      {theta_deg:.2f} deg" if theta_deg is not None else "mean theta      -",
        f"contacts        {measures.contacts} unintended, {measures.state_changes} state changes",
    ]


def _tip_lines(measures: RunMeasures) -> list[str]:
    """Return how often a needle was detected without its tip; nothing if never."""
    count, total = measures.tipless_steps, measures.steps
    if not count:
        return []
    share = f"{count} of {total} steps ({100 * count / total:.1f} %)"
    return [f"tip             not visible in {share}, for up to {measures.longest_tipless_s:.2f} s"]


def _vibration_lines(measures: RunMeasures, report: RunReport | None) -> list[str]:
    """Return how long vibration was commanded, and how long an output confirmed it."""
    patterns = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in measures.vibrating_s.items())
    commanded = (
        f"commanded for {sum(measures.vibrating_s.values()):.2f} s ({patterns})" if patterns else "none"
    )
    confirmed = [f"{s:.2f} s by {output}" for output, s in report.confirmed_s.items()] if report else []
    lines = [f"vibration       {commanded}"]
    return (
        [*lines, f"                confirmed for {', '.join(confirmed)}"] if patterns and confirmed else lines
    )


def _loop_lines(report: RunReport) -> list[str]:
    rate = f"{report.rate_hz:.1f} steps/s"
    lines = [
        f"loop            {report.steps} steps in {report.wall_s:.1f} s, {rate}, {report.ended}",
        f"overruns        {report.overruns} late, {report.skipped} skipped, {report.dropped} not recorded",
    ]
    if report.slipped_s > MIN_SLIPPED * report.duration_s:
        own_s = report.duration_s - report.slipped_s
        slower = f"slower than real time: {own_s:.1f} s of images took {report.duration_s:.1f} s"
        lines.append(f"pace            {slower}")
    if report.force:
        lines.append(f"force           {report.force}")
    lines.append(f"{'stage':16}{'p50':>9}{'p99':>12}")
    for name in STAGES:
        durations = report.stages[name]
        lines.append(f"{name:16}{durations.percentile_ms(50):6.2f} ms{durations.percentile_ms(99):9.2f} ms")
    for fault, count in report.faults.most_common(10):
        lines.append(f"fault           {count} x {fault}")
    return lines
