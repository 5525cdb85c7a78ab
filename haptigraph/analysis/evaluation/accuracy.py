"""The accuracy report: scores on simulated scenes, angle noise at held poses, and a figure of both.

See docs/explanation/accuracy.md.
"""

from collections.abc import Sequence
from pathlib import Path

from haptigraph.analysis.evaluation.angle_noise import angle_noise
from haptigraph.analysis.evaluation.report import Report, sweep_object, sweep_text
from haptigraph.analysis.evaluation.sweep import perceivers_to_compare, sweep
from haptigraph.config import Config
from haptigraph.recording.writer import Progress

__all__ = ["report_simulated"]


def report_simulated(
    scenes: int,
    perceivers: Sequence[str],
    config: Config,
    *,
    seed: int = 0,
    figure: str | Path | None = None,
    progress: Progress | None = None,
) -> Report:
    """Score perceivers on random simulated scenes.

    Args:
        scenes: Number of scenes.
        perceivers: Their names; empty: all that are compared by default.
        config: Settings of all perceivers, and the procedure.
        seed: Seed of the scenes.
        figure: The figure to write, if any.
        progress: Called with the progress.

    Raises:
        BadInput: If a perceiver is unknown or the figure cannot be written.
        MissingExtra: If there is to be a figure, and Matplotlib is not installed.
    """
    if figure is not None:
        from haptigraph.analysis.evaluation.sweep_figure import (  # noqa: PLC0415 - an extra
            check_output,
            sweep_figure,
        )

        check_output(figure)
    names = perceivers or perceivers_to_compare()
    swept = sweep(scenes, names, config, seed=seed, progress=progress)
    held = angle_noise(names, config, seed=seed, progress=progress)
    if figure is not None:
        sweep_figure(swept, held, figure)
    return Report(sweep_object(swept, held), sweep_text(swept, held))
