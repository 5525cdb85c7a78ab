import itertools

import pytest
from ros_network import running

from haptigraph.clock import MonotonicClock, offset_ns
from haptigraph.recording.reader import RunReader

pytestmark = [pytest.mark.timeout(180)]

SAME_S = 1e-3  # two clocks are compared in the run and here; images are 67 ms apart


def inlet_of(pylsl, name):
    found = pylsl.resolve_byprop("name", name, timeout=30)
    assert found, f"no stream {name}"
    return pylsl.StreamInlet(found[0])


def test_an_inlet_receives_a_run_live_with_the_moments_of_its_recording(lsl_network, quick_uri, tmp_path):
    import pylsl

    path = tmp_path / "run.mcap"
    with running(quick_uri, "--bridge", "lsl", "--record", path, "--set", "source.loop=true") as process:
        inlets = {name: inlet_of(pylsl, f"haptigraph.{name}") for name in ("state", "command", "measures")}
        for inlet in inlets.values():
            inlet.open_stream(timeout=30)
        offset_s = offset_ns(lambda: round(pylsl.local_clock() * 1e9), MonotonicClock()) / 1e9
        infos = {name: inlet.info(timeout=30) for name, inlet in inlets.items()}
        kept = pulled(inlets)
    steps = [step for _, step in RunReader(path).records(images=())]
    assert "! bridge" not in process.told

    rows = []
    for sample, stamp_s in kept["measures"][5:-5]:
        (step,) = (step for step in steps if abs(step.stamp_ns / 1e9 - (stamp_s - offset_s)) < SAME_S)
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
    for (state,), stamp_s in kept["state"][1:]:
        assert any(state == name and abs(stamp_s - offset_s - at_s) < SAME_S for name, at_s in changes)
    commanded = [(step.command.pattern.name, step.timing.commanded_ns / 1e9) for step in steps]
    for (pattern,), stamp_s in kept["command"][1:]:
        assert any(pattern == name and abs(stamp_s - offset_s - at_s) < SAME_S for name, at_s in commanded)
    told = {pattern for (pattern,), _ in kept["command"]}
    assert len(told) > 1 and told <= {step.command.pattern.name for step in steps}


def pulled(inlets):
    kept = {name: [] for name in inlets}
    while len(kept["command"]) < 2 or len(kept["measures"]) < 40:
        for name, inlet in inlets.items():
            sample, stamp_s = inlet.pull_sample(timeout=0.05)
            while sample is not None:
                kept[name].append((sample, stamp_s))
                sample, stamp_s = inlet.pull_sample(timeout=0.0)
    for inlet in inlets.values():
        inlet.close_stream()
    return kept


def channels(info, what):
    node, told = info.desc().child("channels").child("channel"), []
    while not node.empty():
        told.append(node.child_value(what))
        node = node.next_sibling("channel")
    return told


def test_streams_say_what_they_hold(lsl_network, run):
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
