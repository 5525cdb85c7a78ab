"""What inference costs per graph: the bit masks, the same rules over NetworkX, and in the rule engine CLIPS.

Measured on every possible graph of each shipped procedure, or of those whose names are given. All are first
seen to agree on every one.
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
    """The rules asked of a NetworkX graph, one after the other."""

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
    """The rules as CLIPS has them: salience is priority, the first that fires halts."""

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
    name: str, graphs: Sequence[SceneGraph], deciders: Iterable[Callable[[SceneGraph], object]]
) -> None:
    """Print median and 99th percentile over rounds of the time per graph; every round has its own decider."""
    rounds = []
    for decide in deciders:
        begun_ns = time.perf_counter_ns()
        for graph in graphs:
            decide(graph)
        rounds.append((time.perf_counter_ns() - begun_ns) / len(graphs) / 1e3)
    high = statistics.quantiles(rounds, n=100)[98]
    print(f"  {name:42}{statistics.median(rounds):9.2f} us{high:11.2f} us")


def compare(procedure: Procedure) -> None:
    """See that all agree on every possible graph, then time them on it."""
    space = Space(procedure.schema)
    graphs = [space.graph(world) for world in {world.mask: world for world in space.worlds()}.values()]
    copies = {id(graph): graph.to_networkx() for graph in graphs}
    ours, over_networkx, over_clips = RuleEngine(procedure), NetworkxRules(procedure), ClipsRules(procedure)
    for graph in graphs:
        ours.reset()  # the others hold no state
        state = ours(graph).state
        if not state == over_networkx(copies[id(graph)]) == over_clips(graph):
            raise SystemExit(f"{procedure.name}: the engines do not agree on {graph}")
    holds = ", with release and hold" if any(state.hold_ms for state in procedure.states) else ""
    print(f"{procedure.name}, {len(graphs)} possible graphs{holds}\n{'p50 per graph':>57}{'p99':>14}")
    measure("bit masks, sentence and evidence included", graphs, repeat(ours, ROUNDS))
    measure("  each graph seen for the first time", graphs, [RuleEngine(procedure) for _ in range(ROUNDS)])

    def prepared(graph: SceneGraph) -> str:
        return over_networkx(copies[id(graph)])

    def built(graph: SceneGraph) -> str:
        return over_networkx(graph.to_networkx())

    measure("NetworkX, the graph built beforehand", graphs, repeat(prepared, ROUNDS))
    measure("NetworkX, the graph built for it", graphs, repeat(built, ROUNDS))
    # A new environment every round: CLIPS slows down as it goes on, eight times within 30,000 graphs.
    measure(f"CLIPS (clipspy {clips.__version__})", graphs, (ClipsRules(procedure) for _ in range(ROUNDS)))
    for prover in ("exhaustive", "z3"):
        begun = time.perf_counter()
        proof = prove(procedure, prover)
        print(f"  proved in {1e3 * (time.perf_counter() - begun):.0f} ms: {proof.method}")


def share_of_step(name: str) -> None:
    """Print what reasoning takes of a whole step, on simulated images."""
    _, pipeline, captures = load(name)
    durations = {stage: Durations() for stage in ("build_scene", "reason", "step")}
    for capture in captures * 3:
        begun_ns = time.perf_counter_ns()
        pipeline.step(capture)
        durations["step"].add(time.perf_counter_ns() - begun_ns)
        for stage in ("build_scene", "reason"):
            durations[stage].add(pipeline.stage_ns[stage])
    p50_us = {stage: 1e3 * some.percentile_ms(50) for stage, some in durations.items()}
    share = 100 * p50_us["reason"] / p50_us["step"]
    print(
        f"  in the loop: graph built in {p50_us['build_scene']:.0f} us, "
        f"reasoned in {p50_us['reason']:.1f} us, {share:.2f} % of a step\n"
    )


def main() -> None:
    """Measure and print."""
    for name in sys.argv[1:] or procedure_names():
        compare(load_procedure(name))
        share_of_step(name)


if __name__ == "__main__":
    main()
