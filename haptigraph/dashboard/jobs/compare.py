"""The job that replays a run under another procedure, as `haptigraph replay --procedure` does."""

from haptigraph.analysis.metrics.replay import replay
from haptigraph.assemble import load_procedure
from haptigraph.dashboard.jobs.read import empty_timeline, recorded_settings
from haptigraph.dashboard.server.describe import describe_relations, describe_states
from haptigraph.dashboard.server.stream import (
    encode_timeline,
    measures_json,
    progress_reporter,
    send_message,
)
from haptigraph.messages import Step
from haptigraph.recording.reader import RunReader

__all__ = ["compare"]


def compare(name: str, procedure_name: str) -> None:
    """Send the timeline of the recorded images under a procedure; empty: under the recorded one."""
    procedure = load_procedure(procedure_name) if procedure_name else recorded_settings(RunReader(name))[0]
    timeline = empty_timeline(procedure)

    def watch(recorded: Step, replayed: Step) -> None:
        timeline.add(replayed)

    progress = progress_reporter("replaying")
    report = replay(name, procedure_name or None, lambda _, done, total: progress(done, done, total), watch)
    content, data = encode_timeline(timeline)
    more = {
        "state_descriptions": describe_states(procedure),
        "relations": describe_relations(procedure),
        "procedure": procedure_name or procedure.name,
        "measures": measures_json(report.replayed, timeline.start_ns),
        "steps": report.steps,
        "identical": report.identical,
        "state_differs": report.states_differ,
        "haptics_differ": report.haptics_differ,
        "dropped_images": report.dropped_images,
        "differing_images": report.differing_images,
    }
    send_message({"type": "comparison", **content, **more}, data)
