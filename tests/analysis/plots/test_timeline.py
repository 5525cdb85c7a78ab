"""A run over time: the panels show what was measured, and nothing else."""

import itertools

import pytest
from evidence_files import record
from matplotlib.figure import Figure
from msgspec.structs import replace

from haptigraph.analysis.plots.series import Series, read_series, series_of
from haptigraph.analysis.plots.timeline import draw_timeline
from haptigraph.assemble import parse_procedure
from haptigraph.errors import BadInput
from haptigraph.messages import OFF, Fault
from haptigraph.recording.reader import RunReader


@pytest.fixture(scope="module")
def series(quick_uri, tmp_path_factory) -> Series:
    return read_series(RunReader(record(quick_uri, tmp_path_factory.mktemp("timeline") / "run.mcap")))


def without(series: Series, *measures: str) -> Series:
    """Return a run that lacks some measures."""

    def lacks(step):
        kept = {name: value for name, value in step.graph.measures.items() if name not in measures}
        return replace(step, graph=replace(step.graph, measures=kept))

    return Series(series.time_s, [lacks(step) for step in series.steps], series.procedure, series.paints)


def test_faults_of_the_device_are_marked(series):
    assert not any("device fault" in labels for labels in drawn(series).values())
    steps = [*series.steps]
    observation = replace(steps[40].observation, faults=(Fault("device", "does not respond"),))
    steps[40] = replace(steps[40], observation=observation)
    faulty = Series(series.time_s, steps, series.procedure, series.paints)
    assert faulty.device_faults_s() == [series.time_s[40]]
    assert sum("device fault" in labels for labels in drawn(faulty).values()) == 1


def test_what_an_output_confirmed_is_drawn_beside_what_was_commanded(series):
    assert drawn(series)["haptic output"] == ["commanded"]
    silent = Series(series.time_s, series.steps, series.procedure, series.paints, [])
    assert drawn(silent)["haptic output"] == ["commanded", "confirmed: 0.00 s"]
    felt = Series(series.time_s, series.steps, series.procedure, series.paints, [(1.0, 1.5), (2.0, 2.25)])
    assert drawn(felt)["haptic output"] == ["commanded", "confirmed: 0.75 s"]


def drawn(series: Series, other: Series | None = None, name: str = "replayed") -> dict[str, list[str]]:
    """Return the labels of every panel by its title."""
    figure = Figure()
    draw_timeline(figure, series, other, name)
    return {
        axes.get_title(loc="left").partition("$  ")[2]: axes.get_legend_handles_labels()[1]
        for axes in figure.axes
    }


def test_angle_and_distances_are_those_of_the_procedure(series):
    panels = drawn(series)
    assert list(panels) == ["state", "angle", "distances", "haptic output"]
    assert panels["angle"] == ["theta", "up to 1.7°"]
    assert panels["distances"] == [
        *("distance to retina", "radial", "distance to target"),
        "thresholds of distance to retina: 0.7, 5.5 mm",
    ]


def test_what_was_not_measured_has_no_curve_and_no_panel(series):
    assert "radial" not in drawn(without(series, "radial_mm"))["distances"]
    assert list(drawn(without(series, "theta_deg"))) == ["state", "distances", "haptic output"]


def test_intervals_follow_each_other_and_pulses_are_sampled(series):
    intervals = series.intervals()
    assert intervals[0][0] == 0 and intervals[-1][1] == len(series.steps)
    assert all(one[1] == other[0] for one, other in itertools.pairwise(intervals))
    amplitudes = series.amplitudes()[1]
    contact_s = [series.span_s(start, end) for start, end, state in intervals if state == "retinal_contact"]
    assert len(contact_s) == 1 and max(amplitudes) == 1.0
    assert series.bounds("distance_to_retina_mm") == [0.7, 5.5]


def test_a_recording_without_steps_is_refused(tmp_path, sparse_uri):
    reader = RunReader(record(sparse_uri, tmp_path / "run.mcap"))
    reader.records = lambda images=None: iter(())
    with pytest.raises(BadInput, match="no complete step to draw"):
        read_series(reader)


def test_another_procedure_is_drawn_below_what_was_recorded_with_a_mark_where_it_differs(series):
    wide = series.procedure.text.replace("= 1.7", "= 4.0")
    steps = [*series.steps]
    state = replace(steps[40].conclusion, state="retinal_contact")
    steps[40] = replace(steps[40], conclusion=state)
    steps[60] = replace(steps[60], command=replace(steps[60].command, pattern=OFF))
    other = series_of(steps, parse_procedure(wide, "wide.toml"))
    assert steps[40] != series.steps[40] and steps[60] != series.steps[60]
    panels = drawn(series, other, "wide.toml")
    assert [title for title in panels if "state" in title or "output" in title] == [
        "state, recorded",
        "state, wide.toml",
        "haptic output, recorded",
        "haptic output, wide.toml",
    ]
    assert panels["angle"][1:] == ["up to 1.7°", "up to 4° as replayed"]
    lasts_s = [series.time_s[number + 1] - series.time_s[number] for number in (40, 60)]
    assert panels["state, wide.toml"] == [f"differs: {lasts_s[0]:.2f} s"]
    assert panels["haptic output, wide.toml"] == ["commanded", f"differs: {lasts_s[1]:.2f} s"]
    same = drawn(series, series)
    assert same["angle"][1:] == ["up to 1.7°"]
    assert not any("differs" in label for labels in same.values() for label in labels)
