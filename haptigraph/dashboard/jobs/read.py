"""Jobs that read whole runs: for the timeline, and for what came of them."""

from pathlib import Path
from typing import Any

import msgspec

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.analysis.metrics.timeline import Timeline
from haptigraph.assemble import parse_procedure
from haptigraph.config import Config
from haptigraph.dashboard.server.describe import describe
from haptigraph.dashboard.server.frames import measures_told, progress, put_frame, timeline_told
from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.inference.procedure import Procedure
from haptigraph.perception.eye_view import IoctView
from haptigraph.recording.reader import Place, RunReader
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.registered import Registered

__all__ = ["empty_timeline", "outcomes", "read_run", "settings_of"]

LARGEST_OUTCOME_MB = 200


def read_run(name: str) -> None:
    """Answer with places, then the timeline and all that the page shows of the run."""
    reader, places = RunReader(name), list[Place]()
    procedure, registration = settings_of(reader)
    timeline, measures = empty_timeline(procedure), RunMeasures.under(procedure)
    told = progress("reading", Path(name).stat().st_size)
    for place, step in reader.places():
        places.append(place)
        timeline.add(step)
        measures.add(step)
        told(len(places), place.end)
    if not places:
        raise BadInput("has no complete step", name)
    put_frame({"type": "places"}, msgspec.json.encode(places))
    config = msgspec.json.decode(reader.info.config, type=Config)
    at_px = [registration.image.to_px(at_mm) for at_mm in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))]
    content, data = timeline_told(timeline)
    more = {
        "hello": describe(config, procedure, registration, IoctView(registration)),
        "image_from_eye_px": at_px,
        "run": {**msgspec.to_builtins(reader.info), "config": "", "registration": "", "procedure": ""},
        "measures": measures_told(measures, timeline.start_ns),
        "notes": _notes(reader, name),
    }
    put_frame({"type": "timeline", **content, **more}, data)


def outcomes(*names: str) -> None:
    """Answer with the measures of runs, one after the other; what is large or unreadable is passed over."""
    for name in names:
        try:
            if Path(name).stat().st_size < LARGEST_OUTCOME_MB * 1e6:
                put_frame({"type": "outcome", "name": name, **_outcome(name)})
        except (HaptigraphError, OSError) as error:
            put_frame({"type": "outcome", "name": name, "problem": str(error)})


def settings_of(reader: RunReader) -> tuple[Procedure, Registered]:
    """Return the procedure and the registration a run was recorded with."""
    name = reader.path.name
    return (
        parse_procedure(reader.info.procedure, f"procedure in {name}"),
        parse_registration(reader.info.registration, f"registration in {name}"),
    )


def empty_timeline(procedure: Procedure) -> Timeline:
    """Return the timeline of a run under a procedure, before its first step."""
    schema = procedure.schema
    measures = dict.fromkeys(schema.measure_name(relation) for relation in schema.relations)
    return Timeline((state.name for state in procedure.states), measures)


def _outcome(name: str) -> dict[str, Any]:
    reader = RunReader(name)
    measures, start_ns = RunMeasures.under(settings_of(reader)[0]), None
    for _, step in reader.records(images=()):
        start_ns = step.stamp_ns if start_ns is None else start_ns
        measures.add(step)
    return measures_told(measures, start_ns or 0)


def _notes(reader: RunReader, name: str) -> list[str]:
    """Say what is not as it should be with a recording that can be read."""
    if reader.is_being_written:
        return ["This run is still being recorded; you see what there is so far."]
    if not reader.is_whole:
        return [f"The recording was interrupted; `haptigraph recover {name}` makes it whole."]
    return []
