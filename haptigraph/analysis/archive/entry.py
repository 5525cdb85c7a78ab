"""Index one recording: its header, hash, outcome, times and faults as a row, and its steps as columns."""

from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from haptigraph.analysis.archive.about import changed_settings, setting_texts
from haptigraph.analysis.exporting.columns import Row, certainty_columns, measure_columns
from haptigraph.analysis.metrics.replay import recorded_config, recorded_procedure
from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.checksum import sha256_of
from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.haptics.pattern import amplitude_at
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Capture, Step
from haptigraph.recording.reader import RunReader
from haptigraph.recording.schema import RunInfo
from haptigraph.scene.meanings import meanings_in

__all__ = ["Entry", "IndexTask", "index_recording"]


OF_ONE_RUN = ("recording.path", "trial.participant", "trial.trial")


class IndexTask(Struct, frozen=True):
    """A recording to index, as it was found."""

    folder: str
    name: str
    """Path relative to the folder."""
    size: int
    changed_ns: int


class Entry(Struct):
    """What an index knows of a recording."""

    row: dict[str, Any]
    """Values by column of the table `runs`; what is not known is left out."""
    steps: dict[str, list[Any]] = {}
    """Columns of the table `steps`, by name."""
    is_being_written: bool = False


def index_recording(task: IndexTask) -> Entry:
    """Index one recording; one that cannot be read gets a row that says why."""
    path = Path(task.folder) / task.name
    row: dict[str, Any] = {"recording": task.name, "bytes": task.size, "changed_ns": task.changed_ns}
    try:
        reader = RunReader(path)
        if reader.is_being_written:
            return Entry(row, is_being_written=True)
        row["sha256"] = sha256_of(path)
        row |= _about(reader)
        return _read(reader, row)
    except (HaptigraphError, msgspec.MsgspecError, OSError) as error:
        problem = error.problem if isinstance(error, BadInput) else str(error)
        return Entry(row | {"problem": problem})


def _about(reader: RunReader) -> dict[str, Any]:
    """Return the columns that come from the header."""
    info: RunInfo = reader.info
    config: dict[str, Any] = msgspec.json.decode(info.config)
    names = ("version", "format", "source", "participant", "trial", "procedure_sha256", "registration_sha256")
    return {
        **{name: getattr(info, name) for name in names},
        "started_utc": info.started_utc,
        "rate_hz": info.rate_hz,
        "perceiver": config.get("perception", {}).get("perceiver", ""),
        "is_interrupted": not reader.is_whole,
        "is_recovered": reader.is_whole and reader.losses is not None,
    }


def _read(reader: RunReader, row: dict[str, Any]) -> Entry:
    procedure = recorded_procedure(reader)
    measures, steps = RunMeasures.under(procedure), _Steps(procedure)
    for capture, step in reader.records(images=()):
        measures.add(step)
        steps.add(capture, step)
    with suppress(BadInput):  # settings of another version; the steps can be read all the same
        row["settings"] = _settings(reader)
    states = dict.fromkeys((state.name for state in procedure.states), 0.0)
    row |= {"procedure": procedure.name, "steps": measures.steps, **steps.totals()}
    row |= _outcome(measures, states)
    return Entry(row, steps.columns)


def _settings(reader: RunReader) -> str:
    """Return the settings that were not the default, besides those that differ in every run."""
    changed = changed_settings(recorded_config(reader))
    return "; ".join(setting_texts({key: changed[key] for key in changed if key not in OF_ONE_RUN}))


def _outcome(measures: RunMeasures, states: dict[str, float]) -> dict[str, Any]:
    last = measures.last
    ended = "hit" if measures.completion_s is not None else "no hit"
    return {
        "length_s": 0.0 if last is None else (last.stamp_ns - measures.first_ns) / 1e9,
        "outcome": "no run" if measures.started_ns is None else ended,
        "completion_s": measures.completion_s,
        "mean_theta_deg": measures.mean_theta_deg,
        "contacts": measures.contacts,
        "state_changes": measures.state_changes,
        "tipless_steps": measures.tipless_steps,
        "longest_tipless_s": measures.longest_tipless_s,
        "run_state_s": {} if measures.started_ns is None else states | measures.state_s,
        "state_s": states | measures.all_state_s,
        "broken_claims": sum(claim.broken for claim in measures.claims),
    }


class _Steps:
    """The columns of a recording's steps, and what is counted over them."""

    def __init__(self, procedure: Procedure) -> None:
        self._kinds = procedure.kinds
        self._numbers = (*certainty_columns(), *measure_columns(meanings_in(procedure.schema)))
        names = ("step", "time_s", "state", "plays", "amplitude", "faults")
        self.columns: dict[str, list[Any]] = {
            name: [] for name in (*names, *(each.name for each in self._numbers))
        }
        self._start_ns = self._images = self._dropped = self._faulty = self._alarms = 0
        self._faults: Counter[str] = Counter()
        self._was_alarm = False

    def add(self, capture: Capture, step: Step) -> None:
        """Append the next step."""
        number = len(self.columns["step"])
        self._start_ns = self._start_ns if number else step.stamp_ns
        row = Row(number, capture, step, self._start_ns)
        values = {
            "step": number,
            "time_s": (step.stamp_ns - self._start_ns) / 1e9,
            "state": step.conclusion.state,
            "plays": step.command.pattern.name,
            "amplitude": amplitude_at(step.command, step.stamp_ns),
            "faults": len(step.faults),
            **{each.name: each.value(row) for each in self._numbers},
        }
        for name, value in values.items():
            self.columns[name].append(value)
        self._faulty += bool(step.faults)
        self._faults.update(fault.where for fault in step.faults)
        is_alarm = self._kinds.get(step.conclusion.state) == "alarm"
        self._alarms += is_alarm and not self._was_alarm
        self._was_alarm = is_alarm

    def totals(self) -> dict[str, Any]:
        """Return what was counted."""
        return {"alarms": self._alarms, "faulty_steps": self._faulty, "faults": dict(self._faults)}
