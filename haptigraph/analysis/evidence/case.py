"""A safety case as data: hazards, the claims about each, and the evidence for every claim."""

from collections.abc import Iterator
from typing import Literal, TypeAlias

from msgspec import Struct

from haptigraph.analysis.evaluation.origin import Origin

__all__ = ["HOLDS", "MIN_TRIALS", "Claim", "Evidence", "HazardCase", "SafetyCase", "Source", "Status"]

Status: TypeAlias = Literal[
    "holds",
    "fails",
    "missing",
    "incomplete",
    "not exercised",
    "stale",
    "other procedure",
    "origin not stated",
]
Source: TypeAlias = Literal["proof", "faults", "accuracy", "runs"]
HOLDS = "holds"
MIN_TRIALS = 60
"""What it takes to say "never": of each kind of faults, as a whole campaign has at least, and of contacts
that could be missed. If none of 60 fails, fewer than 5 % do, at a confidence of 95 %."""


class Evidence(Struct, frozen=True):
    """What supports a claim, or fails to."""

    source: Source
    status: Status
    figure: str
    """What was found, with its numbers; of missing evidence, what would supply it."""
    bar: str
    """What it takes to hold."""
    command: str
    """How to make it."""
    file: str = ""
    sha256: str = ""
    """Of the file, or of the procedure that was proved."""
    version: str = ""
    commit: str = ""
    made: str = ""
    """ISO 8601."""

    @property
    def holds(self) -> bool:
        """Whether the claim may rest on it."""
        return self.status == HOLDS


class Claim(Struct, frozen=True):
    """A statement that is to be true, and its evidence; without any it is not supported."""

    statement: str
    evidence: tuple[Evidence, ...]

    @property
    def holds(self) -> bool:
        """Whether some evidence holds and none fails; what does not count, counts neither way."""
        fails = any(each.status == "fails" for each in self.evidence)
        return not fails and any(each.holds for each in self.evidence)

    def lacks(self, evidence: Evidence) -> bool:
        """Return whether the claim does not hold because of a piece of its evidence."""
        return not self.holds and not evidence.holds


class HazardCase(Struct, frozen=True):
    """A hazard with the claims that it is controlled."""

    hazard: str
    harm: str
    """What may follow."""
    claims: tuple[Claim, ...]

    @property
    def holds(self) -> bool:
        """Whether every claim holds, and there is one."""
        return bool(self.claims) and all(claim.holds for claim in self.claims)


class SafetyCase(Struct, frozen=True):
    """All hazards of one procedure under one software."""

    title: str
    """Of the procedure."""
    file: str
    """The procedure as the user named it."""
    origin: Origin
    hazards: tuple[HazardCase, ...]

    @property
    def holds(self) -> bool:
        """Whether everything holds."""
        return all(hazard.holds for hazard in self.hazards)

    def rows(self) -> Iterator[tuple[str, HazardCase, str, Claim, str, Evidence]]:
        """Yield every piece of evidence with its claim and hazard, each after its identifier."""
        number = 0
        for place, hazard in enumerate(self.hazards, 1):
            for part, claim in enumerate(hazard.claims, 1):
                for evidence in claim.evidence:
                    number += 1
                    yield f"H{place}", hazard, f"G{place}.{part}", claim, f"Sn{number}", evidence

    def counts(self) -> dict[str, int]:
        """Return how many claims hold, and how many do not, by the status of their evidence."""
        counts = {HOLDS: 0}
        for claim in (claim for hazard in self.hazards for claim in hazard.claims):
            status = next((each.status for each in claim.evidence if claim.lacks(each)), HOLDS)
            if any(each.status == "fails" for each in claim.evidence):
                status = "fails"
            counts[status] = counts.get(status, 0) + 1
        return counts
