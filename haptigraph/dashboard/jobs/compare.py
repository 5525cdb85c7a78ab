"""The job that replays a run under another procedure, as `haptigraph replay --procedure` does."""

from haptigraph.analysis.metrics.replay import replay
from haptigraph.assemble import load_procedure
from haptigraph.dashboard.jobs.read import empty_timeline, settings_of
from haptigraph.dashboard.server.describe import describe_states
from haptigraph.dashboard.server.frames import measures_told, progress, put_frame, timeline_told
from haptigraph.messages import Step
from haptigraph.recording.reader import RunReader

__all__ = ["compare"]


def compare(name: str, given: str) -> None:
    """Answer with what a procedure makes of the recorded images; empty: the recorded one again."""
    judging = load_procedure(given) if given else settings_of(RunReader(name))[0]
    timeline = empty_timeline(judging)
    touched = differs = 0

    def watch(then: Step, now: Step) -> None:
        nonlocal touched, differs
        timeline.add(now)
        touched += then.command.pattern != now.command.pattern
        differs += then.conclusion.state != now.conclusion.state

    told = progress("replaying", 0)
    report = replay(name, given or None, lambda _, done, total: told(done, done, total), watch)
    content, data = timeline_told(timeline)
    more = {
        "described": describe_states(judging),
        "procedure": given or judging.name,
        "measures": measures_told(report.replayed, timeline.start_ns),
        "steps": report.steps,
        "identical": report.identical,
        "state_differs": differs,
        "touch_differs": touched,
        "first": report.first.step if report.first else None,
        "dropped_images": report.dropped_images,
    }
    put_frame({"type": "comparison", **content, **more}, data)
