"""The figures of a batch's report, as SVG in its page."""

from collections.abc import Mapping, Sequence

import numpy as np

from haptigraph.analysis.plots.svg import FONT, text_svg
from haptigraph.analysis.words import counted

__all__ = ["paired_bars", "share_bars"]

WIDTH_PX, LEFT_PX, ROW_PX, BAR_PX = 760, 300, 34, 12
COLORS = "#8a8a8a", "#2f6fb3"
EDGES = (0, 1e-9, 0.01, 0.05, 0.2, 0.5, 1.0)
EDGE_TEXTS = ("none", "up to 1 %", "1 to 5 %", "5 to 20 %", "20 to 50 %", "more than half")


def paired_bars(values: Sequence[Mapping[str, float]], names: Sequence[str], unit: str) -> str:
    """Draw two values of each name, one above the other.

    Args:
        values: As recorded, as replayed.
        names: Of the two.
        unit: Of the values.
    """
    rows = sorted({*values[0], *values[1]}, key=lambda name: -max(each.get(name, 0) for each in values))
    largest = max((each.get(name, 0) for name in rows for each in values), default=0) or 1
    parts = []
    for at, (name, color) in enumerate(zip(names, COLORS, strict=True)):
        parts.append(text_svg(LEFT_PX + 200 * at, 14, name, color=color, weight="bold", anchor="start"))
    for row, name in enumerate(rows):
        y = 24 + ROW_PX * row
        parts.append(text_svg(LEFT_PX - 10, y + 17, name.replace("_", " "), anchor="end"))
        for at, (each, color) in enumerate(zip(values, COLORS, strict=True)):
            value = each.get(name, 0)
            parts.append(
                _bar(
                    y + (BAR_PX + 1) * at,
                    value / largest,
                    color,
                    f"{value:.2f} s" if unit == "s" else f"{value} {unit}",
                )
            )
    return _svg(24 + ROW_PX * len(rows), parts)


def share_bars(shares: Sequence[float]) -> str:
    """Draw how many recordings have which share of steps with another state."""
    counts, _ = np.histogram(np.asarray(shares, float), EDGES)
    largest, parts = max(int(counts.max(initial=0)), 1), []
    for row, (text, count) in enumerate(zip(EDGE_TEXTS, counts.tolist(), strict=True)):
        y = 6 + 22 * row
        parts.append(text_svg(LEFT_PX - 10, y + 11, text, anchor="end"))
        parts.append(_bar(y, count / largest, COLORS[1], counted(count, "recording")))
    return _svg(10 + 22 * len(EDGE_TEXTS), parts)


def _bar(y: int, share: float, color: str, text: str) -> str:
    width = round(share * (WIDTH_PX - LEFT_PX - 150), 1)
    label = text_svg(LEFT_PX + width + 6, y + 10, text, size_px=11, anchor="start")
    return f'<rect x="{LEFT_PX}" y="{y}" width="{width}" height="{BAR_PX}" fill="{color}"/>{label}'


def _svg(height: int, parts: Sequence[str]) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH_PX} {height}" width="{WIDTH_PX}" '
        f'height="{height}" {FONT} role="img">{"".join(parts)}</svg>'
    )
