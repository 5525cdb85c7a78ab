import itertools

import numpy as np
import pytest
from ros_network import running

from haptigraph.clock import MonotonicClock, offset_ns
from haptigraph.recording.reader import RunReader

pytestmark = [pytest.mark.timeout(180)]

TOLERANCE_S = 1e-3  # of comparing two clocks in two processes; images are 67 ms apart


def inlet_of(pylsl, name):
    found = pylsl.resolve_byprop("name", name, timeout=30)
    assert found, f"no stream {name}"
    return pylsl.StreamInlet(found[0])


def test_an_inlet_receives_a_run_live_with_the_stamps_of_its_recording(lsl_network, quick_uri, tmp_path):
    import pylsl

    path = tmp_path / "run.mcap"
    with running(quick_uri, "--bridge", "lsl", "--record", path, "--set", "source.loop=true") as process:
        inlets = {name: inlet_of(pylsl, f"haptigraph.{name}") for name in ("state", "command", "measures")}
        for inlet in inlets.values():
            inlet.open_stream(timeout=30)
        offset_s = offset_ns(lambda: round(pylsl.local_clock() * 1e9), MonotonicClock()) / 1e9
        infos = {name: inlet.info(timeout=30) for name, inlet in inlets.items()}
        samples = pull(inlets)
    steps = [step for _, step in RunReader(path).records(images=())]
    assert "! bridge" not in process.output

    rows = []
    for sample, stamp_s in samples["measures"][5:-5]:
        (step,) = (step for step in steps if abs(step.stamp_ns / 1e9 - (stamp_s - offset_s)) < TOLERANCE_S)
        rows.append((step, sample))
    assert len(rows) >= 30
    names = channels(infos["measures"], "label")
    assert {"theta_deg", "distance_to_retina_mm"} <= set(names)
    for step, sample in rows:
        for name, value in zip(names, sample, strict=True):
            assert value == step.graph.measures.get(name, pytest.approx(float("nan"), nan_ok=True))
    changes = [
        (step.conclusion.state, step.stamp_ns / 1e9)
        for before, step in itertools.pairwise(steps)
        if step.conclusion.state != before.conclusion.state
    ]
    for (state,), stamp_s in samples["state"][1:]:
        assert any(state == name and abs(stamp_s - offset_s - at_s) < TOLERANCE_S for name, at_s in changes)
    commanded = [(step.command.pattern.name, step.timing.commanded_ns / 1e9) for step in steps]
    for (pattern,), stamp_s in samples["command"][1:]:
        assert any(
            pattern == name and abs(stamp_s - offset_s - at_s) < TOLERANCE_S for name, at_s in commanded
        )
    patterns = {pattern for (pattern,), _ in samples["command"]}
    assert len(patterns) > 1 and patterns <= {step.command.pattern.name for step in steps}


def pull(inlets):
    samples = {name: [] for name in inlets}
    while len(samples["command"]) < 2 or len(samples["measures"]) < 40:
        for name, inlet in inlets.items():
            sample, stamp_s = inlet.pull_sample(timeout=0.05)
            while sample is not None:
                samples[name].append((sample, stamp_s))
                sample, stamp_s = inlet.pull_sample(timeout=0.0)
    for inlet in inlets.values():
        inlet.close_stream()
    return samples


def channels(info, key):
    node, values = info.desc().child("channels").child("channel"), []
    while not node.empty():
        values.append(node.child_value(key))
        node = node.next_sibling("channel")
    return values


def test_streams_are_described(lsl_network, run):
    import pylsl

    from haptigraph.bridges.lsl import LslLink

    link = LslLink("", run)
    measures, state = (
        inlet_of(pylsl, "haptigraph.measures").info(30),
        inlet_of(pylsl, "haptigraph.state").info(30),
    )
    link.close()
    assert channels(measures, "label") == ["theta_deg", "distance_to_retina_mm"]
    assert channels(measures, "unit") == ["degrees", "millimeters"]
    assert (state.type(), state.nominal_srate(), state.channel_format()) == ("Markers", 0.0, pylsl.cf_string)
    for info in (measures, state):
        assert info.desc().child_value("procedure_sha256") == run.info.procedure_sha256
        assert info.desc().child_value("image_rate_hz") == "30"


def test_a_live_run_that_is_stored_as_xdf_has_the_stamps_of_its_recording(lsl_network, quick_uri, tmp_path):
    """Bridge, inlet, file, pyxdf; beside it, the export of the same run's recording."""
    import pylsl

    from haptigraph.analysis.exporting.lsl_streams import LslStream
    from haptigraph.analysis.exporting.xdf import XdfFile, run_xdf

    pyxdf = pytest.importorskip("pyxdf")
    recorded, live, exported = (tmp_path / name for name in ("run.mcap", "live.xdf", "exported.xdf"))
    with running(quick_uri, "--bridge", "lsl", "--record", recorded, "--set", "source.loop=true") as process:
        inlets = {name: inlet_of(pylsl, f"haptigraph.{name}") for name in ("state", "command", "measures")}
        infos = {name: inlet.info(timeout=30) for name, inlet in inlets.items()}
        offset_s = offset_ns(lambda: round(pylsl.local_clock() * 1e9), MonotonicClock()) / 1e9
        samples = pull(inlets)
    assert "! bridge" not in process.output
    file = XdfFile("2026-01-01T00:00:00+00:00", 0.0)
    for name, info in infos.items():
        labels = tuple(channels(info, "label"))
        number = file.add_stream(LslStream(info.name(), info.type(), labels, {}))
        for values, stamp_s in samples[name]:
            file.add_sample(number, values, stamp_s - offset_s)
    live.write_bytes(file.content())
    run_xdf(recorded, exported)
    loaded, whole = (
        {stream["info"]["name"][0]: stream for stream in pyxdf.load_xdf(str(path))[0]}
        for path in (live, exported)
    )
    assert set(loaded) == set(whole) == {"haptigraph.state", "haptigraph.command", "haptigraph.measures"}
    for name, stream in loaded.items():
        assert stream["info"]["channel_format"] == whole[name]["info"]["channel_format"]
        assert stream["info"]["type"] == whole[name]["info"]["type"]
    measures, all_measures = loaded["haptigraph.measures"], whole["haptigraph.measures"]
    assert len(measures["time_stamps"]) >= 40
    for stamp_s, values in zip(measures["time_stamps"], measures["time_series"], strict=True):
        distances_s = np.abs(all_measures["time_stamps"] - stamp_s)
        assert distances_s.min() < TOLERANCE_S
        assert np.array_equal(values, all_measures["time_series"][distances_s.argmin()], equal_nan=True)
    command, commands = loaded["haptigraph.command"], whole["haptigraph.command"]
    for stamp_s, (pattern,) in list(zip(command["time_stamps"], command["time_series"], strict=True))[1:]:
        at = np.abs(commands["time_stamps"] - stamp_s).argmin()
        assert abs(commands["time_stamps"][at] - stamp_s) < TOLERANCE_S
        assert commands["time_series"][at] == [pattern]
