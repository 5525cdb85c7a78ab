"""The result of a proof: all claims, each violated one with the smallest graph that violates it."""

from msgspec import Struct

from haptigraph.graph import SceneGraph

__all__ = ["Claim", "Proof", "Violation"]


class Violation(Struct, frozen=True):
    """One claim that is not true."""

    sentence: str
    """What is wrong, and how to correct it."""
    about: str
    """The part of the procedure that is concerned: "state outside_eye"."""
    graph: SceneGraph | None = None
    """A smallest counterexample, with example measures. If the claim is that something is possible, the graph
    that is not; None if there is none to show."""
    is_possible: bool = True
    """Whether that graph can occur."""
    state: str = ""
    """Its state according to the rule engine."""
    still_holding: tuple[str, ...] = ()
    """Edges of it that hold only if they held in the previous image (`release`)."""


class Claim(Struct, frozen=True):
    """One statement that is to be true of every possible graph by itself."""

    name: str
    statement: str
    violations: tuple[Violation, ...] = ()
    not_while_held: tuple[str, ...] = ()
    """States that violate it while they are held (`hold_ms`) although the graph has changed."""
    not_while_waiting: tuple[str, ...] = ()
    """States in whose graphs a later rule violates it while they wait to be entered (`enter_after_ms`)."""

    @property
    def holds(self) -> bool:
        """Whether it is proved."""
        return not self.violations


class Proof(Struct, frozen=True):
    """All claims about one procedure."""

    procedure: str
    sha256: str
    method: str
    """How it was proved, and over how many graphs."""
    claims: tuple[Claim, ...]
    monitored: tuple[str, ...] = ()
    """Temporal claims: runs monitor them, nothing is proved about them."""
    held_ms: dict[str, float] = {}
    """States that outlast their graph, and how long. Claims are about graphs, not about time."""
    uncovered: tuple[str, ...] = ()
    """What no claim covers, a phrase each."""

    @property
    def holds(self) -> bool:
        """Whether every claim is proved."""
        return all(claim.holds for claim in self.claims)

    @property
    def violations(self) -> list[Violation]:
        """All violations of all claims."""
        return [violation for claim in self.claims for violation in claim.violations]
