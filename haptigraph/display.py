"""What a person at a prompt or in a notebook sees of the library's objects: which function shows each.

The objects are in low layers; what draws them is in `analysis`, and is imported when a person looks. Nothing
in the package calls these methods or uses what they return ([decision 0071] in docs/decisions).
"""

from typing import TYPE_CHECKING, Any

from haptigraph.errors import MissingExtra
from haptigraph.importing import load

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

__all__ = ["VIEWS", "ShownAsHtml", "ShownAsSvg", "ShownRun", "view"]

NOTEBOOK = "haptigraph.analysis.notebook"
VIEWS = {
    "Conclusion": f"{NOTEBOOK}.tables:conclusion_html",
    "Procedure": "haptigraph.analysis.plots.diagram:diagram_svg",
    "RunReader": f"{NOTEBOOK}.tables:run_html",
    "RunReport": f"{NOTEBOOK}.tables:report_html",
    "SceneGraph": f"{NOTEBOOK}.pictures:graph_svg",
    "Step": f"{NOTEBOOK}.tables:step_html",
    "dataframe": f"{NOTEBOOK}.frames:run_dataframe",
    "graph figure": f"{NOTEBOOK}.pictures:graph_figure",
    "run figure": f"{NOTEBOOK}.pictures:run_figure",
    "xarray": f"{NOTEBOOK}.frames:run_xarray",
}
"""Functions by the class that they show, or by what they make of a run or a graph."""


def view(name: str, shown: object) -> Any:
    """Return what a function of `VIEWS` makes of an object."""
    return load(VIEWS[name])(shown)


class ShownAsHtml:
    """An object that notebooks show as HTML."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        return str(view(type(self).__name__, self))


class ShownAsSvg:
    """An object that notebooks show as a diagram."""

    __slots__ = ()

    def _repr_svg_(self) -> str | None:
        try:
            return str(view(type(self).__name__, self))
        except MissingExtra:
            return None  # a notebook then shows the repr


class ShownRun(ShownAsHtml):
    """A recorded run as a table or a figure."""

    __slots__ = ()

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return the run as a table: one row a step, indexed by `time_s`, with the columns of an export.

        `attrs` has unit and meaning of every column, and what the recording's header says of the run.

        Raises:
            BadInput: If the recording is damaged, or has no complete step.
            MissingExtra: If pandas is not installed.
        """
        table: pandas.DataFrame = view("dataframe", self)
        return table

    def to_xarray(self) -> "xarray.Dataset":
        """Return the run as variables over `time_s`: the columns of `to_dataframe`, with their units.

        Raises:
            BadInput: If the recording is damaged, or has no complete step.
            MissingExtra: If xarray or pandas is not installed.
        """
        variables: xarray.Dataset = view("xarray", self)
        return variables

    def plot(self) -> "Figure":
        """Draw states, angles, distances with their thresholds, and haptic output over time.

        Raises:
            BadInput: If the recording is damaged, or has no complete step.
            MissingExtra: If Matplotlib is not installed.
        """
        figure: Figure = view("run figure", self)
        return figure
