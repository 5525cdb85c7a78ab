"""Say what a recording is: what its header states, and what its steps count up to. No image is decoded."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from haptigraph.analysis.metrics.replay import recorded_config, recorded_procedure, recorded_registration
from haptigraph.config import Config
from haptigraph.recording.header import losses_sentence
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress
from haptigraph.registration.assumed import assumed_text

__all__ = ["About", "about_lines", "about_recording", "changed_settings", "setting_texts", "state_of"]

MAX_FAULTS = 10
HASH_DIGITS = 12


class About(Struct, frozen=True):
    """What a recording is."""

    recording: str
    state: str
    """Whether it is complete, or what is missing."""
    version: str
    """Of haptigraph, which wrote it."""
    format: str
    started_utc: str
    source: str
    rate_hz: float
    perceiver: str
    procedure: str
    procedure_sha256: str
    registration_sha256: str
    assumed: tuple[str, ...]
    """What the registration assumes, by name."""
    participant: str
    trial: str
    settings: dict[str, Any]
    """Those that are not this version's default, by key."""
    attached: dict[str, str]
    """SHA-256 of the other files in the header, by name."""
    own_classes: tuple[str, ...]
    robot_shift: str
    steps: int
    duration_s: float
    dropped_images: int
    """Images that perception processed but the recording lacks."""
    faults: dict[str, int]
    """How many steps have each."""
    has_truth: bool
    """Whether a simulator's ground truth is recorded, so that perception can be scored."""


def about_recording(path: str | Path, progress: Progress | None = None) -> About:
    """Read a recording's header and count its steps.

    Args:
        path: The recording.
        progress: Called with the progress.

    Raises:
        BadInput: If it cannot be read.
    """
    reader = RunReader(path)
    info, config = reader.info, recorded_config(reader)
    total, dropped = reader.count()
    first_ns = last_ns = 0
    faults, has_truth = Counter[str](), False
    for number, (capture, step) in enumerate(reader.records(images=()), 1):
        first_ns, last_ns = first_ns if number > 1 else step.stamp_ns, step.stamp_ns
        faults.update({str(fault) for fault in step.faults})
        has_truth |= capture.truth is not None
        if progress is not None:
            progress("reading", number, total)
    attached = {name: getattr(info, f"{name}_sha256") for name in ("robot_setup", "device_profile")}
    return About(
        recording=str(path),
        state=state_of(reader),
        version=info.version,
        format=info.format,
        started_utc=info.started_utc,
        source=info.source,
        rate_hz=info.rate_hz,
        perceiver=config.perception.perceiver,
        procedure=recorded_procedure(reader).name,
        procedure_sha256=info.procedure_sha256,
        registration_sha256=info.registration_sha256,
        assumed=recorded_registration(reader).assumed,
        participant=info.participant,
        trial=info.trial,
        settings=changed_settings(config),
        attached={name: digest for name, digest in attached.items() if digest},
        own_classes=tuple(info.own_classes.splitlines()),
        robot_shift=info.robot_shift,
        steps=total,
        duration_s=(last_ns - first_ns) / 1e9,
        dropped_images=dropped,
        faults=dict(faults.most_common()),
        has_truth=has_truth,
    )


def about_lines(about: About) -> list[str]:
    """Return the same for people, line by line."""
    assumed = f", assumes {assumed_text(about.assumed)}" if about.assumed else ""
    hashes = {"procedure": about.procedure_sha256, "registration": about.registration_sha256} | about.attached
    short = {name: f"sha256 {digest[:HASH_DIGITS]}" for name, digest in hashes.items()}
    rows = [
        ("recording", f"{about.recording}, {about.state}"),
        ("started", f"{about.started_utc}, by haptigraph {about.version}, format {about.format}"),
        ("source", f"{about.source}, {about.rate_hz:g} images/s"),
        ("participant", f"{about.participant}, trial {about.trial or '-'}" if about.participant else ""),
        ("perceiver", about.perceiver),
        ("procedure", f"{about.procedure}, {short.pop('procedure')}"),
        ("registration", f"{short.pop('registration')}{assumed}"),
        *((name.replace("_", " "), digest) for name, digest in short.items()),
        *(("own class", line) for line in about.own_classes),
        ("robot", about.robot_shift),
        *(("setting", text) for text in setting_texts(about.settings)),
        (
            "length",
            f"{about.steps} steps in {about.duration_s:.2f} s, {about.dropped_images} images not recorded",
        ),
        *(("fault", f"{count} x {fault}") for fault, count in list(about.faults.items())[:MAX_FAULTS]),
        ("fault", "" if about.faults else "none" if about.state == "complete" else "none in these steps"),
        ("ground truth", "recorded: it is of a simulation" if about.has_truth else "none"),
    ]
    return [f"{name:16}{value}" for name, value in rows if value]


def state_of(reader: RunReader) -> str:
    """Return whether a recording is complete, or what is missing."""
    lost = losses_sentence(reader.losses) if reader.losses else ""
    if reader.is_being_written:
        return "still being written"
    if not reader.is_whole:
        return f"{lost or 'interrupted'}; `haptigraph recover` repairs the file"
    return f"recovered; {lost}" if lost else "complete"


def setting_texts(settings: Mapping[str, Any]) -> list[str]:
    """Return settings as KEY=VALUE, with the value as JSON."""
    return [f"{key}={msgspec.json.encode(value).decode()}" for key, value in settings.items()]


def changed_settings(config: Config) -> dict[str, Any]:
    """Return the settings that are not this version's default, by key."""
    used, default = msgspec.to_builtins(config), msgspec.to_builtins(Config())
    return {
        f"{table}.{key}": value
        for table, values in used.items()
        for key, value in values.items()
        if value != default[table][key]
    }
