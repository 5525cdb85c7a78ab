"""Describe a run: the header of its recording, which bridges publish too."""

import datetime
import hashlib
import time
from collections.abc import Container
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
from msgspec.structs import replace

from haptigraph.clock import Clock, offset_ns
from haptigraph.config import Config
from haptigraph.importing import is_own, module_sha256, split_own
from haptigraph.recording.schema import RunInfo
from haptigraph.stages import Source

if TYPE_CHECKING:
    from haptigraph.inference.procedure import Procedure
    from haptigraph.registration.registered import BaseRegistration

__all__ = ["own_classes", "run_info", "run_info_at"]


def run_info(
    config: Config,
    source: Source,
    registration: "BaseRegistration",
    procedure: "Procedure",
    clock: Clock,
    version: str,
    robot_setup: str = "",
    device_profile: str = "",
    own_classes: str = "",
) -> RunInfo:
    """Return the header of a run that starts now.

    Args:
        config: The configuration.
        source: The opened source.
        registration: Position of the anatomy in the images.
        procedure: Rules and haptic patterns.
        clock: The run's.
        version: Of haptigraph.
        robot_setup: Text of robot.toml; empty: no robot, or not calibrated.
        device_profile: Text of the device's profile; empty: none.
        own_classes: As of the function of that name.
    """
    utc_offset_ns = offset_ns(time.time_ns, clock)
    started = datetime.datetime.fromtimestamp((clock.now_ns() + utc_offset_ns) / 1e9, datetime.UTC)
    info = run_info_at(started, utc_offset_ns, config, source.rate_hz, registration, procedure, version)
    for name, text in (("robot_setup", robot_setup), ("device_profile", device_profile)):
        if text:
            digest = hashlib.sha256(text.encode()).hexdigest()
            info = replace(info, **{name: text, f"{name}_sha256": digest})
    if (camera := source.depth_camera) is not None:
        info = replace(info, depth_camera=msgspec.json.encode(camera).decode())
    return replace(info, own_classes=own_classes)


def own_classes(config: Config, shipped: Container[str]) -> str:
    """Return the user's own classes in a configuration, as `RunInfo.own_classes` keeps them.

    Args:
        config: The configuration, whose classes have been imported.
        shipped: Kinds of perceivers, sources and devices that ship with haptigraph.
    """
    settings = {
        "perceiver": config.perception.perceiver,
        "source": config.source.uri,
        "device": config.haptics.device,
    }
    own = {
        what: split_own(name)[0]
        for what, name in settings.items()
        if is_own(name) and name.partition(":")[0] not in shipped and not Path(name).exists()
    }
    return "\n".join(f"{what} {name} {module_sha256(name)}".strip() for what, name in own.items())


def run_info_at(
    started: datetime.datetime,
    utc_offset_ns: int,
    config: Config,
    rate_hz: float,
    registration: "BaseRegistration",
    procedure: "Procedure",
    version: str,
) -> RunInfo:
    """Return the header of a run that started at a given time; its clock is `utc_offset_ns` behind UTC."""
    return RunInfo(
        version=version,
        started_utc=started.isoformat(),
        utc_offset_ns=utc_offset_ns,
        source=config.source.uri,
        rate_hz=rate_hz,
        config=msgspec.json.encode(config).decode(),
        registration=registration.text,
        registration_sha256=registration.sha256,
        procedure=procedure.text,
        procedure_sha256=procedure.sha256,
        participant=config.trial.participant,
        trial=config.trial.trial,
    )
