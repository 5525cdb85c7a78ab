"""Figure of the scores of questionnaires by condition."""

import numpy as np

from haptigraph.analysis.study.figures.states import POINT
from haptigraph.analysis.study.figures.style import (
    ONE_COLUMN_MM,
    TWO_COLUMNS_MM,
    condition_legend,
    condition_styles,
    declutter,
    draw_box,
    new_figure,
    wrapped,
)
from haptigraph.analysis.study.results import StudyResults
from haptigraph.figures import Figure
from haptigraph.study.questionnaire import Questionnaire

__all__ = ["questionnaire_figure"]

MAX_NARROW = 6
"""Number of boxes that have room in one column."""


def questionnaire_figure(results: StudyResults, note: str) -> Figure | None:
    """Draw the scores of further questionnaires, one panel each: a box by condition; None without any."""
    scored = [each for each in results.questionnaires if _scores(results, each)]
    if not scored:
        return None
    most = max(len(_scores(results, each)) for each in scored)
    width_mm = ONE_COLUMN_MM if most * len(results.conditions) <= MAX_NARROW else TWO_COLUMNS_MM
    figure = new_figure(width_mm, 60 * len(scored), note)
    styles, spread = condition_styles(results.conditions), 0.76 / len(results.conditions)
    for axes, each in zip(np.ravel(figure.subplots(len(scored), 1)), scored, strict=True):
        names = _scores(results, each)
        for number, condition in enumerate(results.conditions):
            for place, name in enumerate(names):
                values = results.values[name][condition].dropna().to_numpy(float)
                at = place + (number - (len(results.conditions) - 1) / 2) * spread
                draw_box(axes, values, at, 0.82 * spread, styles[condition])
                aside = np.linspace(-0.22, 0.22, max(len(values), 2))[: len(values)] * spread
                axes.plot(at + aside, values, styles[condition].marker, **POINT)
        labels = [wrapped(results.quantities[name].label, (width_mm - 17) / len(names)) for name in names]
        axes.set(xlim=(-0.5, len(names) - 0.5), ylabel=f"score ({results.quantities[names[0]].unit})")
        axes.set_xticks(range(len(names)), labels)
        declutter(axes)
    condition_legend(figure, results.titles)
    return figure


def _scores(results: StudyResults, questionnaire: Questionnaire) -> list[str]:
    """Return the scores with values that are no primary measures."""
    names = [scale.name for scale in questionnaire.scales if scale.name in results.values]
    return [name for name in names if results.quantities[name].family == "questionnaires"]
