"""What a proof says: every claim, and where one is violated, the smallest graph that breaks it."""

from msgspec import Struct

from haptigraph.graph import SceneGraph

__all__ = ["Claim", "Proof", "Violation"]


class Violation(Struct, frozen=True):
    """One claim that is not true."""

    sentence: str
    """What is wrong, and what would mend it."""
    about: str
    """What of the procedure it is about: "state outside_eye"."""
    graph: SceneGraph | None = None
    """A smallest possible graph that breaks the claim, with example measures. Where the claim is that
    something can be, the graph that cannot be; None where there is none to show."""
    is_possible: bool = True
    """Whether that graph can be seen at all."""
    state: str = ""
    """What the rule engine makes of it."""
    still_holding: tuple[str, ...] = ()
    """Edges of it that hold only if they held in the image before (`release`)."""


class Claim(Struct, frozen=True):
    """One thing that is to be true of every possible graph by itself."""

    name: str
    says: str
    violations: tuple[Violation, ...] = ()
    not_while_held: tuple[str, ...] = ()
    """States that break it while they are held (`hold_ms`) though the graph is another by itself."""

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
    watched: tuple[str, ...] = ()
    """Claims about time, which runs are watched for; nothing is proved of them."""
    held_ms: dict[str, float] = {}
    """States that outlast their graph, and how long. Claims are about graphs, not about time."""

    @property
    def holds(self) -> bool:
        """Whether every claim is proved."""
        return all(claim.holds for claim in self.claims)

    @property
    def violations(self) -> list[Violation]:
        """All that is wrong."""
        return [violation for claim in self.claims for violation in claim.violations]
