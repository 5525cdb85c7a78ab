"""Prove the general claims about every procedure and those that its author makes."""

from typing import Literal

from haptigraph.haptics.profiles.fit import unmeasured
from haptigraph.haptics.profiles.profile import DeviceProfile
from haptigraph.inference.coverage import uncovered
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Capabilities
from haptigraph.proof.claims.colors import color_claims
from haptigraph.proof.claims.follow import follow_claims
from haptigraph.proof.claims.forces import force_claims
from haptigraph.proof.claims.haptic import device_claims, haptic_claims
from haptigraph.proof.claims.invariants import invariant_claims
from haptigraph.proof.claims.profiled import profile_claims
from haptigraph.proof.claims.reported import reported_claim
from haptigraph.proof.claims.rules import rules_claims
from haptigraph.proof.claims.thresholds import threshold_claims
from haptigraph.proof.claims.time import time_claims
from haptigraph.proof.report import Proof
from haptigraph.proof.subject import Subject
from haptigraph.stages import PerceiverClass

__all__ = ["prove"]


def prove(
    procedure: Procedure,
    prover: Literal["auto", "exhaustive", "z3"] = "auto",
    device: tuple[str, Capabilities] | None = None,
    perceiver: tuple[str, PerceiverClass] | None = None,
    profile: DeviceProfile | None = None,
) -> Proof:
    """Check every claim against every possible graph.

    Args:
        procedure: A checked procedure.
        prover: The method; auto: enumerate the graphs if there are few, else z3.
        device: Name and capabilities of a device that is to play the haptic grammar.
        perceiver: Name and class of the perceiver that is to report the entities.
        profile: How strong the device feels; None: not known.

    Raises:
        MissingExtra: If z3 is needed and not installed.
    """
    subject = Subject(procedure, prover)
    if device and profile:
        device = device[0], profile.applied_to(device[1])
    reported, unseen = reported_claim(procedure, *perceiver) if perceiver else (None, ())
    claims = (
        *rules_claims(subject),
        *threshold_claims(subject),
        *invariant_claims(subject),
        *time_claims(subject),
        *haptic_claims(procedure),
        *follow_claims(procedure),
        *force_claims(subject),
        *color_claims(procedure),
        *(device_claims(procedure, *device, profile) if device else ()),
        *(profile_claims(procedure, *device, profile) if device and profile else ()),
        *((reported,) if reported else ()),
    )
    held_ms = {state.name: state.hold_ms for state in procedure.states if state.hold_ms}
    temporal = tuple(claim.name for claim in procedure.temporal)
    missing = uncovered(procedure)
    if device and device[1].frequency_range_hz is None:
        missing.append(f"how patterns differ by frequency: {device[0]} plays one of its own")
    if profile:
        missing += unmeasured(procedure.patterns, profile)
    method = subject.prover.method
    return Proof(procedure.name, procedure.sha256, method, claims, temporal, held_ms, (*missing, *unseen))
