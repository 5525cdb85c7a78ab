"""Check a figure as a journal would that prints it at its size."""

from itertools import combinations

from matplotlib.figure import Figure
from matplotlib.text import Text

from haptigraph.analysis.study.figures.style import ONE_COLUMN_MM, TWO_COLUMNS_MM

SMALLEST_PT = 6.5


def check_print(figure: Figure, note: str) -> None:
    """Refuse what a journal would: another width, small text, texts that overlap, or are cut off; and a title."""
    figure.draw_without_rendering()
    width_mm = 25.4 * figure.get_figwidth()
    assert min(abs(width_mm - column) for column in (ONE_COLUMN_MM, TWO_COLUMNS_MM)) < 1e-6
    assert figure.get_suptitle() == note
    texts = _shown_texts(figure)
    assert min(text.get_fontsize() for text in texts) >= SMALLEST_PT
    extents = {text: text.get_window_extent() for text in texts}
    for one, other in combinations(texts, 2):
        overlap = extents[one].padded(-0.3).overlaps(extents[other].padded(-0.3))
        assert not overlap, f"{one.get_text()!r} overlaps {other.get_text()!r}"
    drawn = figure.get_tightbbox()
    assert drawn.x0 >= 0 and drawn.y0 >= 0
    assert drawn.x1 <= figure.get_figwidth() and drawn.y1 <= figure.get_figheight()


def _shown_texts(figure: Figure) -> list[Text]:
    """The texts that are drawn: of ticks, those within the limits."""
    ticks, inside = set(), []
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        low, high = sorted(axis.get_view_interval())
        for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
            ticks |= {tick.label1, tick.label2}
            inside += [tick.label1] if low <= tick.get_loc() <= high and axis.axes.axison else []
    others = [text for text in figure.findobj(Text) if text not in ticks]
    return [text for text in [*others, *inside] if text.get_visible() and text.get_text().strip()]
