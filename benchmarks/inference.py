"""Time of inference per graph: bit masks, the same rules on NetworkX graphs, and in the rule engine CLIPS.

Measured on every possible graph of each shipped procedure, or of the named ones, after checking that all
engines agree on each graph.
"""

import statistics
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from itertools import repeat

import clips
import networkx
from loop import load

from haptigraph.assemble import load_procedure, procedure_names
from haptigraph.graph import Names, SceneGraph
from haptigraph.inference.engine import RuleEngine
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import UNKNOWN
from haptigraph.proof.prove import prove
from haptigraph.proof.space import Space
from haptigraph.run_report import Durations

ROUNDS = 300


class NetworkxRules:
    """The rules evaluated on a NetworkX graph, one after the other."""

    def __init__(self, procedure: Procedure) -> None:
        self.states = procedure.states

    def __call__(self, graph: "networkx.MultiDiGraph[str]") -> str:
        """Return the state of a graph."""

        def there(names: Names) -> bool:
            return graph.has_edge(names[0], names[2], key=names[1])

        for state in self.states:
            if (
                all(there(names) for names in state.when)
                and not any(there(names) for names in state.unless)
                and not any(name in graph for name in state.absent)
            ):
                return state.name
        return UNKNOWN


class ClipsRules:
    """The rules in CLIPS: salience is priority, the first rule that fires halts."""

    def __init__(self, procedure: Procedure) -> None:
        self.clips = clips.Environment()
        self.clips.build("(deftemplate edge (slot s) (slot p) (slot o))")
        self.clips.build("(deftemplate node (slot n))")
        self.clips.build(f"(defglobal ?*state* = {UNKNOWN})")
        for number, state in enumerate(procedure.states):
            parts = [_fact(names) for names in state.when]
            parts += [f"(not {_fact(names)})" for names in state.unless]
            parts += [f"(not (node (n {name})))" for name in state.absent]
            salience = len(procedure.states) - number
            self.clips.build(
                f"(defrule r{number} (declare (salience {salience})) {' '.join(parts)} "
                f"=> (bind ?*state* {state.name}) (halt))"
            )
        self.edge, self.node = self.clips.find_template("edge"), self.clips.find_template("node")

    def __call__(self, graph: SceneGraph) -> str:
        """Return the state of a graph."""
        symbol = clips.Symbol
        self.clips.reset()
        for node in graph.nodes:
            self.node.assert_fact(n=symbol(node.category))
        for edge in graph.edges:
            self.edge.assert_fact(s=symbol(edge.subject), p=symbol(edge.predicate), o=symbol(edge.object))
        self.clips.run()
        return str(self.clips.find_global("state").value)


def _fact(names: Names) -> str:
    return f"(edge (s {names[0]}) (p {names[1]}) (o {names[2]}))"


def measure(
    name: str, graphs: Sequence[SceneGraph], engines: Iterable[Callable[[SceneGraph], object]]
) -> None:
    """Print median and 99th percentile over rounds of the time per graph; every round has its own engine."""
    rounds = []
    for decide in engines:
        start_ns = time.perf_counter_ns()
        for graph in graphs:
            decide(graph)
        rounds.append((time.perf_counter_ns() - start_ns) / len(graphs) / 1e3)
    high = statistics.quantiles(rounds, n=100)[98]
    print(f"  {name:42}{statistics.median(rounds):9.2f} us{high:11.2f} us")


def compare(procedure: Procedure) -> None:
    """Check that all engines agree on every possible graph, then time them."""
    space = Space(procedure.schema)
    graphs = [space.graph(world) for world in {world.mask: world for world in space.worlds()}.values()]
    copies = {id(graph): graph.to_networkx() for graph in graphs}
    ours, over_networkx, over_clips = RuleEngine(procedure), NetworkxRules(procedure), ClipsRules(procedure)
    for graph in graphs:
        ours.reset()  # the others are stateless
        state = ours(graph).state
        if not state == over_networkx(copies[id(graph)]) == over_clips(graph):
            raise SystemExit(f"{procedure.name}: the engines do not agree on {graph}")
    holds = ", with release and hold" if any(state.hold_ms for state in procedure.states) else ""
    print(f"{procedure.name}, {len(graphs)} possible graphs{holds}\n{'p50 per graph':>57}{'p99':>14}")
    measure("bit masks, with sentence and evidence", graphs, repeat(ours, ROUNDS))
    measure("  each graph for the first time", graphs, [RuleEngine(procedure) for _ in range(ROUNDS)])

    def prepared(graph: SceneGraph) -> str:
        return over_networkx(copies[id(graph)])

    def built(graph: SceneGraph) -> str:
        return over_networkx(graph.to_networkx())

    measure("NetworkX, with prepared graphs", graphs, repeat(prepared, ROUNDS))
    measure("NetworkX, including the graph's creation", graphs, repeat(built, ROUNDS))
    # A new environment every round, as CLIPS slows down over time, by a factor of 8 within 30,000 graphs.
    measure(f"CLIPS (clipspy {clips.__version__})", graphs, (ClipsRules(procedure) for _ in range(ROUNDS)))
    for prover in ("exhaustive", "z3"):
        start_s = time.perf_counter()
        proof = prove(procedure, prover)
        print(f"  proved in {1e3 * (time.perf_counter() - start_s):.0f} ms: {proof.method}")


def share_of_step(name: str) -> None:
    """Print the share of inference in the time of a step, on simulated images."""
    _, pipeline, captures = load(name)
    durations = {stage: Durations() for stage in ("build_scene", "reason", "step")}
    for capture in captures * 3:
        start_ns = time.perf_counter_ns()
        pipeline.step(capture)
        durations["step"].add(time.perf_counter_ns() - start_ns)
        for stage in ("build_scene", "reason"):
            durations[stage].add(pipeline.stage_ns[stage])
    p50_us = {stage: 1e3 * times.percentile_ms(50) for stage, times in durations.items()}
    share = 100 * p50_us["reason"] / p50_us["step"]
    print(
        f"  in the loop: scene graph {p50_us['build_scene']:.0f} us, "
        f"inference {p50_us['reason']:.1f} us, {share:.2f} % of a step\n"
    )


def main() -> None:
    """Measure and print."""
    for name in sys.argv[1:] or procedure_names():
        compare(load_procedure(name))
        share_of_step(name)


if __name__ == "__main__":
    main()
