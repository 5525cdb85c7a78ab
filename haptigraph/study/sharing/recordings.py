"""Copy a recording under a participant's new name, without date, paths and the camera's clock."""

import warnings
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path, PureWindowsPath
from typing import Any

import msgspec
from msgspec.structs import replace

from haptigraph.assemble import parse_procedure
from haptigraph.errors import RenamedKey
from haptigraph.recording.reader import RunReader
from haptigraph.recording.schema import FORMAT, RunInfo
from haptigraph.recording.writer import RunWriter
from haptigraph.registration.loading import parse_registration
from haptigraph.study.sharing.rekeying import shifted

__all__ = ["copy_recording"]


def copy_recording(source: Path, target: Path, participant: str, person: Mapping[str, Any]) -> bool:
    """Copy a recording step by step; nothing but steps, procedure and registration gets into the copy.

    Args:
        source: The recording.
        target: The new one; its folder is created.
        participant: The new name.
        person: The participant's row, whose enrolment all times are counted from.

    Returns:
        False if images were not recorded, which a copy could not state; then nothing is written.

    Raises:
        BadInput: If the recording cannot be read, or the copy cannot be written.
    """
    reader = RunReader(source)
    if reader.count()[1]:
        return False
    registration = parse_registration(reader.info.registration, f"registration in {source}")
    with warnings.catch_warnings(action="ignore", category=RenamedKey):  # of a procedure that is as it is
        procedure = parse_procedure(reader.info.procedure, f"procedure in {source}")
    target.parent.mkdir(parents=True, exist_ok=True)
    info = _anonymous(reader.info, participant, person)
    writer = RunWriter(target, info, registration.image, procedure.schema.measure_names)
    try:
        for capture, step in reader.records():
            writer.write(replace(capture, camera=None), step)
        writer.close()
    except BaseException:
        writer.discard()
        raise
    return True


def _anonymous(info: RunInfo, participant: str, person: Mapping[str, Any]) -> RunInfo:
    started_utc = shifted(info.started_utc, person)
    earlier = datetime.fromisoformat(info.started_utc) - datetime.fromisoformat(started_utc)
    config: dict[str, Any] = _without_folders(msgspec.json.decode(info.config))
    config.get("trial", {})["participant"] = participant
    return replace(
        info,
        source=_without_folders(info.source),
        participant=participant,
        started_utc=started_utc,
        utc_offset_ns=info.utc_offset_ns - round(earlier.total_seconds() * 1e9),
        config=msgspec.json.encode(config).decode(),
        decoder="",
        device_profile="",  # it names who felt the device, and when
        device_profile_sha256="",
        format=FORMAT,
    )


def _without_folders(setting: Any) -> Any:
    """Return settings in which paths are names of files; folders may name people."""
    if isinstance(setting, dict):
        return {key: _without_folders(value) for key, value in setting.items()}
    if isinstance(setting, list):
        return [_without_folders(value) for value in setting]
    is_path = isinstance(setting, str) and ("/" in setting or "\\" in setting)
    return PureWindowsPath(setting).name if is_path else setting  # knows both separators
