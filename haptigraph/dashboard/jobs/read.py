"""The jobs that read whole runs: for the timeline, and for the outcomes in the list."""

from pathlib import Path
from typing import Any

import msgspec

from haptigraph.analysis.metrics.replay import recorded_config
from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.analysis.metrics.timeline import Timeline
from haptigraph.assemble import parse_procedure
from haptigraph.dashboard.server.describe import describe_run
from haptigraph.dashboard.server.stream import (
    encode_timeline,
    measures_json,
    progress_reporter,
    send_message,
)
from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.inference.procedure import Procedure
from haptigraph.perception.eye_view import view_of
from haptigraph.recording.header import losses_sentence
from haptigraph.recording.reader import RunReader, StepLocation
from haptigraph.registration.assumed import assumed_text
from haptigraph.registration.camera import Registration
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.registered import BaseRegistration

__all__ = ["empty_timeline", "measure_outcomes", "read_run", "recorded_settings"]

MAX_OUTCOME_MB = 200


def read_run(name: str) -> None:
    """Send the places of a run's steps in its file, then its timeline and what else the page shows of it."""
    reader, places = RunReader(name), list[StepLocation]()
    procedure, registration = recorded_settings(reader)
    timeline, measures = empty_timeline(procedure), RunMeasures.under(procedure)
    progress = progress_reporter("reading", Path(name).stat().st_size)
    for place, step in reader.places():
        places.append(place)
        timeline.add(step)
        measures.add(step)
        progress(len(places), place.end)
    if not places:
        raise BadInput("has no complete step", name)
    send_message({"type": "places"}, msgspec.json.encode(places))
    config = recorded_config(reader)
    at_px = [registration.image.to_px(at_mm) for at_mm in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))]
    content, data = encode_timeline(timeline)
    more = {
        "hello": describe_run(config, procedure, registration, view_of(registration)),
        "image_from_eye_px": at_px,
        "run": {**msgspec.to_builtins(reader.info), "config": "", "registration": "", "procedure": ""},
        "measures": measures_json(measures, timeline.start_ns),
        "has_truth": isinstance(registration, Registration) and _has_truth(reader),
        "notes": [*_notes(reader, name), *_assumed_notes(registration)],
    }
    send_message({"type": "timeline", **content, **more}, data)


def _has_truth(reader: RunReader) -> bool:
    capture, _ = next(reader.records(images=()))
    return capture.truth is not None


def measure_outcomes(*names: str) -> None:
    """Send the measures of runs, one after the other; large files are skipped."""
    for name in names:
        try:
            if Path(name).stat().st_size < MAX_OUTCOME_MB * 1e6:
                send_message({"type": "outcome", "name": name, **_outcome(name)})
        except (HaptigraphError, OSError) as error:
            send_message({"type": "outcome", "name": name, "problem": str(error)})


def recorded_settings(reader: RunReader) -> tuple[Procedure, BaseRegistration]:
    """Return the procedure and the registration that a run was recorded with."""
    name = reader.path.name
    return (
        parse_procedure(reader.info.procedure, f"procedure in {name}"),
        parse_registration(reader.info.registration, f"registration in {name}"),
    )


def empty_timeline(procedure: Procedure) -> Timeline:
    """Return a timeline without steps, for runs under a procedure."""
    schema = procedure.schema
    measures = dict.fromkeys(schema.measure_name(relation) for relation in schema.relations)
    return Timeline((state.name for state in procedure.states), measures)


def _outcome(name: str) -> dict[str, Any]:
    reader = RunReader(name)
    measures, start_ns = RunMeasures.under(recorded_settings(reader)[0]), None
    for _, step in reader.records(images=()):
        start_ns = step.stamp_ns if start_ns is None else start_ns
        measures.add(step)
    return measures_json(measures, start_ns or 0)


def _assumed_notes(registration: BaseRegistration) -> list[str]:
    if not registration.assumed:
        return []
    return [f"The registration assumes {assumed_text(registration.assumed)}: not measured."]


def _notes(reader: RunReader, name: str) -> list[str]:
    """Return warnings about a recording that can be read."""
    if reader.is_being_written:
        return ["This run is still being recorded; the page shows what has been written so far."]
    lost = losses_sentence(reader.losses) if reader.losses else ""
    if not reader.is_whole:
        cause = f"This recording is incomplete: {lost}" if lost else "The recording was interrupted"
        return [f"{cause}; repair it with `haptigraph recover {name}`."]
    return [f"This recording was recovered; {lost}."] if lost else []
