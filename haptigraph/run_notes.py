"""What the user should know before a run: what is assumed, what source and device cannot do."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from haptigraph.config import Config
from haptigraph.haptics.pattern import unsupported
from haptigraph.haptics.profiles.fit import profile_notes
from haptigraph.haptics.profiles.profile import DeviceProfile
from haptigraph.inference.coverage import NEEDLE_3D, ROBOT_TIP, unreported_notes
from haptigraph.registration.assumed import assumed_notes
from haptigraph.stages import Device, PerceiverClass, Source

if TYPE_CHECKING:
    from haptigraph.inference.procedure import Procedure
    from haptigraph.registration.registered import BaseRegistration

__all__ = ["run_notes"]


def run_notes(
    config: Config,
    source: Source,
    procedure: "Procedure",
    device: Device,
    registration: "BaseRegistration",
    class_of: Callable[[str], PerceiverClass],
    profile: DeviceProfile | None = None,
) -> list[str]:
    """Return what the user should know before a run, a sentence each."""
    is_accepted = config.haptics.accept_assumed
    haptics = config.haptics
    capabilities = profile.applied_to(device.capabilities) if profile else device.capabilities
    limits = [note for pattern in procedure.patterns for note in unsupported(pattern, capabilities)]
    if profile is not None:
        limits += profile_notes(profile, haptics.device, procedure.patterns, haptics.max_amplitude)
    notes = [
        *assumed_notes(registration.assumed, registration.how_to_state, is_accepted=is_accepted),
        *source.notes,
        *unreported_notes(procedure, config.perception.perceiver, class_of),
        *(f"{haptics.device}: {note}" for note in limits),
    ]
    if any(entity.name == ROBOT_TIP for entity in procedure.schema.entities) and not (
        config.robot.setup or source.robot_setup
    ):
        notes.append(
            f"{procedure.name} compares the robot's tip with that in the image, but no calibrated robot is "
            "read: give --robot and --robot-setup"
        )
    notes += _depth_notes(source, procedure, registration)
    if registration.image.slices is not None:
        notes.append(
            f"{source.rate_hz:g} volumes/s: haptic output ends {config.haptics.deadman_ms:g} ms after the "
            "last one at the latest (haptics.deadman_ms)"
        )
    if config.haptics.sham_seed is not None:
        notes.append("the vibration is a sham: it comes at random times and warns of nothing")
    if config.haptics.force:
        notes.append(
            f"{config.haptics.force} pushes the hand while its clutch is held; research software, not a "
            "medical device: keep the device's own switch at hand"
        )
    elif config.source.uri.partition(":")[0] == "teleop":
        notes.append(
            "the needle moves only if you steer it: on the page of `haptigraph live`, by --leader, by "
            "--force, or by --bridge ros2"
        )
    return notes


def _depth_notes(source: Source, procedure: "Procedure", registration: "BaseRegistration") -> list[str]:
    """Return why the needle out of the section is not known, where a procedure or a source has depth."""
    needs = any(entity.name == NEEDLE_3D for entity in procedure.schema.entities)
    has_plane = registration.depth is not None
    if source.depth_camera is None and (needs or has_plane):
        why = "the source delivers no depth"
    elif source.depth_camera is not None and not has_plane:
        why = "the registration does not say where the section is in depth; register again with depth"
    else:
        return []
    return [f"the angle of the needle out of the section is not measured: {why}"]
