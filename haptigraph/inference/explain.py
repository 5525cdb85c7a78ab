"""Say in a sentence why a rule fired. Knows the graph's measures; decides nothing."""

from haptigraph.graph import SceneGraph
from haptigraph.inference.procedure import State

__all__ = ["because"]


class _Missing:
    """Stands in a sentence for a measure that this graph does not carry."""

    def __format__(self, spec: str) -> str:
        return "?"


class _Measures(dict[str, object]):
    def __missing__(self, name: str) -> object:
        return _Missing()


def because(state: State, graph: SceneGraph) -> str:
    """Fill the measures of a graph into the sentence of a state."""
    try:
        return state.because.format_map(graph.measures)
    except KeyError:
        return state.because.format_map(_Measures(graph.measures))
