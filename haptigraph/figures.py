"""Matplotlib, an extra: everything that draws takes it from here."""

from haptigraph.errors import MissingExtra

try:
    from matplotlib import rc_context
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.colors import PowerNorm, to_rgb
    from matplotlib.figure import Figure, FigureBase, SubFigure
    from matplotlib.layout_engine import ConstrainedLayoutEngine
    from matplotlib.lines import Line2D
    from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Patch
    from matplotlib.patheffects import withStroke
    from matplotlib.transforms import Bbox
except ModuleNotFoundError:
    raise MissingExtra("a figure", "figures") from None

__all__ = [
    "Artist",
    "Axes",
    "Bbox",
    "ConstrainedLayoutEngine",
    "FancyArrowPatch",
    "FancyBboxPatch",
    "Figure",
    "FigureBase",
    "FigureCanvasAgg",
    "Line2D",
    "LineCollection",
    "Patch",
    "PolyCollection",
    "PowerNorm",
    "SubFigure",
    "rc_context",
    "to_rgb",
    "withStroke",
]
