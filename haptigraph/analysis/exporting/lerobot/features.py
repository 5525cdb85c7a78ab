"""The features of a LeRobot dataset, from the columns of the exported table."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal, NamedTuple

from haptigraph.analysis.exporting.columns import Column, Row
from haptigraph.inference.procedure import Procedure

__all__ = ["IMAGE", "Feature", "features_of"]

IMAGE = "observation.images.camera"
VECTORS = {
    "observation.state": ("measures", "needle"),
    "observation.robot": ("robot",),
    "observation.hand": ("hand",),
    "observation.force": ("force",),
    "action": ("action",),
    "haptics.output": ("haptics",),
    "truth": ("truth",),
}
"""Groups of columns in each; columns without a value in any run are left out."""
TEXTS = {"surgical_state": "state", "surgical_phase": "phase", "haptics.pattern": "plays"}


class Feature(NamedTuple):
    """One feature: what a step's row holds under a name."""

    name: str
    dtype: Literal["float32", "int64", "string"]
    channels: tuple[tuple[str, str, str], ...]
    """Name, unit and meaning of each."""
    values: Callable[[Row], Sequence[Any]]
    """Of every channel in a step; an unknown number is NaN."""

    @property
    def about(self) -> dict[str, Any]:
        """What `meta/info.json` says of it."""
        names = None if self.dtype == "string" else [name for name, _, _ in self.channels]
        return {"dtype": self.dtype, "shape": [len(self.channels)], "names": names}


def features_of(columns: Sequence[Column], procedure: Procedure) -> tuple[Feature, ...]:
    """Return the features besides the image and those of every LeRobot dataset.

    Args:
        columns: Those that have a value in some run.
        procedure: That of all runs.
    """
    by_name = {column.name: column for column in columns}
    return (
        *_vectors(columns),
        *(_text(name, by_name[column]) for name, column in TEXTS.items() if column in by_name),
        _triplets(procedure),
        _states(procedure),
        _one(
            "observation.has_image",
            "whether the step has an image; without one, it is black",
            lambda row: row.capture.image is not None,
        ),
        _one(
            "stamp_ns", "when the image was captured, on the run's clock", lambda row: row.step.stamp_ns, "ns"
        ),
    )


def _vectors(columns: Sequence[Column]) -> Iterator[Feature]:
    for name, groups in VECTORS.items():
        chosen = [
            column
            for column in columns
            if column.group in groups and (column.kind == "number" or column.group == "truth")
        ]
        if chosen:
            channels = tuple((column.name, column.unit, column.meaning) for column in chosen)
            yield Feature(name, "float32", channels, _values(chosen))


def _values(columns: Sequence[Column]) -> Callable[[Row], list[float]]:
    def values(row: Row) -> list[float]:
        found = [column.value(row) for column in columns]
        return [float("nan") if value is None else value for value in found]

    return values


def _text(name: str, column: Column) -> Feature:
    return Feature(name, "string", ((name, "", column.meaning),), lambda row: [column.value(row) or ""])


def _triplets(procedure: Procedure) -> Feature:
    names = [f"<{', '.join(relation.names)}>" for relation in procedure.schema.relations]
    names = list(dict.fromkeys(names))

    def values(row: Row) -> list[int]:
        edges = {str(edge) for edge in row.step.graph.edges}
        return [int(name in edges) for name in names]

    meaning = "whether the relation holds in the scene graph: 1 or 0"
    return Feature("scene_graph.triplets", "int64", tuple((name, "", meaning) for name in names), values)


def _states(procedure: Procedure) -> Feature:
    numbers = {state.name: number for number, state in enumerate(procedure.states)}
    meaning = ", ".join(f"{number} {name}" for name, number in numbers.items())
    return _one(
        "surgical_state_index",
        f"{meaning}; -1 any other",
        lambda row: numbers.get(row.step.conclusion.state, -1),
    )


def _one(name: str, meaning: str, value: Callable[[Row], int], unit: str = "") -> Feature:
    return Feature(name, "int64", ((name, unit, meaning),), lambda row: [int(value(row))])
