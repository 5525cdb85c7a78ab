"""Figure of the scores of questionnaires by condition."""

import numpy as np
from matplotlib.figure import Figure

from haptigraph.analysis.study.figures.states import POINT
from haptigraph.analysis.study.figures.style import (
    condition_legend,
    condition_styles,
    declutter,
    draw_box,
    new_figure,
)
from haptigraph.analysis.study.results import StudyResults
from haptigraph.study.questionnaire import Questionnaire

__all__ = ["questionnaire_figure"]


def questionnaire_figure(results: StudyResults, note: str) -> Figure | None:
    """Draw the scores of further questionnaires, one panel each: a box by condition; None without any."""
    scored = [each for each in results.questionnaires if _scores(results, each)]
    if not scored:
        return None
    most = max(len(_scores(results, each)) for each in scored)
    size = max(4.0, 1.2 * most), 3.2 * len(scored) + 0.4
    figure = new_figure(*size, "Scores of questionnaires", note)
    for axes, each in zip(np.ravel(figure.subplots(len(scored), 1)), scored, strict=True):
        names = _scores(results, each)
        styles, spread = condition_styles(results.conditions), 0.76 / len(results.conditions)
        for number, condition in enumerate(results.conditions):
            for place, name in enumerate(names):
                values = results.values[name][condition].dropna().to_numpy(float)
                at = place + (number - (len(results.conditions) - 1) / 2) * spread
                draw_box(axes, values, at, 0.82 * spread, styles[condition])
                aside = np.linspace(-0.22, 0.22, max(len(values), 2))[: len(values)] * spread
                axes.plot(at + aside, values, styles[condition].marker, **POINT)
        labels = [results.quantities[name].label.replace(" ", "\n") for name in names]
        axes.set(xlim=(-0.5, len(names) - 0.5), ylabel=f"score ({results.quantities[names[0]].unit})")
        axes.set_xticks(range(len(names)), labels)
        declutter(axes)
    below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.24), "ncols": len(results.conditions)}
    condition_legend(axes, results.titles, **below)
    return figure


def _scores(results: StudyResults, questionnaire: Questionnaire) -> list[str]:
    """Return the scores with values that are no primary measures."""
    names = [scale.name for scale in questionnaire.scales if scale.name in results.values]
    return [name for name in names if results.quantities[name].family == "questionnaires"]
