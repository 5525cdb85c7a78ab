"""The accuracy report: the sweep, the noise of held angles, and the figure of both. See docs/accuracy.md."""

from pathlib import Path

from haptigraph.analysis.evaluation.angle_noise import angle_noise
from haptigraph.analysis.evaluation.report import Report, sweep_object, sweep_text
from haptigraph.analysis.evaluation.sweep import perceivers_to_compare, sweep
from haptigraph.analysis.evaluation.sweep_figure import check_output, sweep_figure
from haptigraph.config import Config
from haptigraph.recording.writer import Progress

__all__ = ["report_simulated"]


def report_simulated(
    scenes: int,
    perceiver: str | None,
    config: Config,
    *,
    seed: int = 0,
    figure: str | Path | None = None,
    progress: Progress | None = None,
) -> Report:
    """Score perceivers on random simulated scenes.

    Args:
        scenes: How many.
        perceiver: Its name; None: all that are worth comparing.
        config: Settings of all perceivers, and the procedure.
        seed: Of the scenes.
        figure: The picture to write, if any.
        progress: Told how far it is.

    Raises:
        BadInput: If there is no such perceiver or the figure could not be written.
    """
    if figure is not None:
        check_output(figure)
    names = [perceiver] if perceiver else perceivers_to_compare()
    swept = sweep(scenes, names, config, seed=seed, progress=progress)
    held = angle_noise(names, config, seed=seed, progress=progress)
    if figure is not None:
        sweep_figure(swept, held, figure)
    return Report(sweep_object(swept, held), sweep_text(swept, held))
