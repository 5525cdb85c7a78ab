"""A perceiver, a source or a device of the user's own, by "module:Class" (tests/support/own_parts.py)."""

import sys
import time
from pathlib import Path

import pytest
from helpers import call
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.analysis.batch.scoring import report_recording
from haptigraph.analysis.metrics.replay import recorded_procedure, replay, replay_steps
from haptigraph.clock import MonotonicClock, VirtualClock
from haptigraph.config import load_config
from haptigraph.errors import BadInput
from haptigraph.haptics.observed_device import is_felt
from haptigraph.haptics.watchdog import HOLDS_MS
from haptigraph.importing import is_own, module_sha256, split_own
from haptigraph.messages import Certainty
from haptigraph.recording.reader import RunReader
from haptigraph.sources.naming import split_source

OWN = Path(__file__).parents[1] / "support" / "own_parts.py"


def error_of(*settings: str) -> str:
    with pytest.raises(BadInput) as raised:
        assemble.build(load_config(None, settings))
    return str(raised.value)


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("mine:Mine", ("mine:Mine", "")),
        ("my.lab:Mine:a:b", ("my.lab:Mine", "a:b")),
        ("phantom:hover", None),
        ("ros2:/camera/Image", None),
        ("C:Clip.mp4", None),
        ("console", None),
    ],
)
def test_a_class_of_ones_own_is_a_module_and_a_name_with_a_capital(name, parts):
    assert is_own(name) == (parts is not None)
    if parts:
        assert split_own(name) == parts


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        (
            "nowhere:Mine",
            "Python finds no module 'nowhere'; install it, name its folder in PYTHONPATH, or start `python -m",
        ),
        ("own_parts.inner:Mine", "Python finds no module 'own_parts.inner'"),
        (
            "broken_lab:Mine",
            "importing 'broken_lab' fails (ModuleNotFoundError: No module named 'absent_lib')",
        ),
        ("wrong_lab:Mine", "importing 'wrong_lab' fails (SyntaxError: "),
        ("own_parts:Percever", "module 'own_parts' has no class 'Percever'; did you mean 'Perceiver'?"),
        ("own_parts:GEOMETRY", "module 'own_parts' has no class 'GEOMETRY'"),
        (
            "own_parts:WithoutMembers",
            "lacks entities, entities_with_sd, images; define what haptigraph.stages.Per",
        ),
    ],
)
def test_a_perceiver_that_cannot_be_used_is_one_sentence(name, problem, sparse_uri, tmp_path, monkeypatch):
    (tmp_path / "broken_lab.py").write_text("import absent_lib")
    (tmp_path / "wrong_lab.py").write_text("class Mine(:")
    monkeypatch.syspath_prepend(tmp_path)
    message = error_of(f"source.uri={sparse_uri}", f"perception.perceiver={name}")
    assert message.startswith(f"perceiver {name}")
    assert problem in message
    done = call("run", sparse_uri, "--fast", "--set", f"perception.perceiver={name}")
    assert (done.exit_code, done.output.count("\n")) == (2, 1)


@pytest.fixture
def recording(quick_uri, tmp_path, monkeypatch):
    """A run of a perceiver in a module of the user's own."""
    (tmp_path / "mine.py").write_text(OWN.read_text())
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    path = tmp_path / "run.mcap"
    settings = f"source.uri={quick_uri}", f"recording.path={path}", "perception.perceiver=mine:Perceiver"
    assemble.build(load_config(None, (*settings, "run.realtime=false"))).run()
    yield path
    sys.modules.pop("mine", None)


def test_a_recording_names_the_perceiver_and_replays_with_it(recording):
    info = RunReader(recording).info
    assert info.own_classes == f"perceiver mine:Perceiver {module_sha256('mine:Perceiver')}"
    report = replay(recording)
    assert report.identical == report.steps > 50
    assert report.notes[0] == (
        "perceiver mine:Perceiver is not part of haptigraph; its module is unchanged since the run"
    )
    reader = RunReader(recording)
    scores = report_recording(reader, recorded_procedure(reader)).scores
    assert (scores["perceiver"], scores["note"]) == ("mine:Perceiver", report.notes[0])


def test_a_replay_says_that_the_module_has_changed(recording):
    with recording.with_name("mine.py").open("a") as file:
        file.write("# a change\n")
    output = call("replay", recording).output
    assert "its module has changed since the run, so steps may differ" in output


def test_a_replay_without_the_module_is_one_sentence(recording):
    recording.with_name("mine.py").unlink()
    sys.modules.pop("mine")
    done = call("replay", recording)
    assert done.exit_code == 2
    assert done.output == (
        f"haptigraph: {recording}: cannot be replayed without the perceiver of its run: perceiver mine:Perceiver: "
        "Python finds no module 'mine'; install it, name its folder in PYTHONPATH, or start `python -m haptigraph` in its folder; perceivers that "
        "ship: bscan, forceps, segmentation, threshold, tracker, volume\n"
    )
    with pytest.raises(BadInput, match="cannot be replayed without the perceiver of its run"):
        next(replay_steps(RunReader(recording)))


def test_a_shipped_perceiver_leaves_nothing_to_record(sparse_uri, tmp_path):
    path = tmp_path / "run.mcap"
    settings = (
        f"source.uri={sparse_uri}",
        f"recording.path={path}",
        f"haptics.device=trace:{tmp_path / 'Out.csv'}",
    )
    loop = assemble.build(load_config(None, (*settings, "run.realtime=false")))
    loop.run()
    assert RunReader(path).info.own_classes == ""


def test_a_source_of_ones_own_gets_its_argument_and_is_recorded(tmp_path):
    path = tmp_path / "run.mcap"
    assert split_source("own_parts:FilmSource:scan.vol", assemble.SOURCES) == (
        "own_parts:FilmSource",
        "scan.vol",
    )
    settings = ("source.uri=own_parts:FilmSource:5", f"recording.path={path}")
    config = load_config(None, settings)
    assert not assemble.is_realtime(config)
    assert assemble.build(config).run().steps == 5 + 1  # the end is a step
    info = RunReader(path).info
    assert info.source == "own_parts:FilmSource:5"
    assert info.own_classes.startswith("source own_parts:FilmSource ")


def test_a_live_source_of_ones_own_gets_the_clock_and_runs_in_real_time():
    config = load_config(None, ("source.uri=own_parts:LiveSource",))
    assert assemble.is_realtime(config)
    clock = MonotonicClock()
    raw = replace(config, source=replace(config.source, jpeg_quality=0))
    assert assemble.open_source(raw, clock)._source.clock is clock
    assert type(assemble.open_source(config, clock)).__name__ == "JpegSource"
    assert "works in real time" in error_of("source.uri=own_parts:LiveSource", "run.realtime=false")


def test_a_source_says_on_its_class_whether_it_is_live():
    with pytest.raises(BadInput, match="LateSource: is_live is True; set it on the class, not on the object"):
        assemble.open_source(load_config(None, ("source.uri=own_parts:LateSource",)), VirtualClock())


def test_a_device_of_ones_own_is_felt_and_watched(tmp_path):
    name = f"own_parts:Device:{tmp_path / 'out.txt'}"
    assert is_felt(name)
    assert not is_felt("trace:Out")
    device = assemble.open_device(name)
    start_s = time.monotonic()
    device.set(0.5, 80.0, 0)
    device.close()
    is_stalled = time.monotonic() - start_s > HOLDS_MS / 1e3  # then the watch plays 0
    assert type(device).__name__ == "WatchedDevice"
    played = (tmp_path / "out.txt").read_text().split()
    assert played == ["0.5", "closed"] or (is_stalled and played == ["0.5", "0", "closed"])


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("nowhere:Mine", "device nowhere:Mine: Python finds no module 'nowhere'"),
        ("own_parts:DeviceWithoutMembers", "device own_parts:DeviceWithoutMembers lacks close, set"),
        ("own_parts:Device:/nowhere/x", "FileNotFoundError: [Errno 2]"),
    ],
)
def test_a_device_that_cannot_be_opened_is_one_sentence(name, problem):
    with pytest.raises(BadInput) as raised:
        assemble.open_device(name)
    assert problem in str(raised.value)


def test_numbers_of_numpy_become_plain_and_are_recorded(sparse_uri, tmp_path):
    runs = {}
    for name in ("Returning", "NumpyPerceiver"):
        path = tmp_path / f"{name}.mcap"
        settings = (
            f"source.uri={sparse_uri}",
            f"recording.path={path}",
            f"perception.perceiver=own_parts:{name}",
        )
        report = assemble.build(load_config(None, (*settings, "run.realtime=false"))).run()
        assert (report.incomplete, report.dropped) == ("", 0)
        runs[name] = [step.observation for step in RunReader(path)]
    assert runs["NumpyPerceiver"] == runs["Returning"]
    assert runs["Returning"][0].certainty == Certainty(1.0, 0.05, 0.5)


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("NonePerceiver", " returned None instead of an Observation; is a `return` missing?"),
        ("DictPerceiver", " returned a dict instead of an Observation"),
        ("NanPerceiver", ": needle_tip.at_mm[0]: Expected `float`, got None, nan or inf"),
        ("TuplePerceiver", ": needle_tip is a tuple; it must be one of Point, Segment, Circle, "),
        ("TextPerceiver", ": certainty.tip_sd_mm: Expected `float | null`, got `str`"),
        (
            "MisspeltPerceiver",
            " reports an unknown entity 'needle_lin'; did you mean 'needle_line'? valid: eye_globe, ",
        ),
    ],
)
def test_what_a_perceiver_may_not_return_ends_the_run_in_one_sentence(name, problem, sparse_uri):
    done = call("run", sparse_uri, "--fast", "--set", f"perception.perceiver=own_parts:{name}")
    (line,) = [line for line in done.output.splitlines() if line.startswith("haptigraph: ")]
    assert f"image 0: perceiver own_parts:{name}{problem}" in line
    assert done.exit_code == 2
    assert "Traceback" not in done.output


def test_an_entity_with_a_standard_deviation_is_one_that_is_reported(sparse_uri):
    assert error_of(f"source.uri={sparse_uri}", "perception.perceiver=own_parts:MisspeltSdPerceiver") == (
        "perceiver own_parts:MisspeltSdPerceiver: unknown entity 'needle_tip_sd'; did you mean 'needle_tip'? valid: "
        "needle_line, needle_tip; entities_with_sd is a part of entities"
    )


def test_what_a_perceiver_raises_is_named_with_its_line(sparse_uri, capfd, monkeypatch):
    line = 1 + OWN.read_text().splitlines().index(
        "        return np.linalg.inv(np.zeros((2, 2)))  # raised in NumPy"
    )
    done = call("run", sparse_uri, "--fast", "--set", "perception.perceiver=own_parts:RaisingPerceiver")
    assert done.exit_code == 2
    sentence = (
        "own_parts:RaisingPerceiver raised LinAlgError: Singular matrix (own_parts.py, line "
        f"{line}); `python -X dev -m haptigraph` prints the traceback"
    )
    assert f"haptigraph: perception failed on 3 images in a row: {sentence}\n" in done.output


def test_a_source_may_count_with_numpy(tmp_path):
    path = tmp_path / "run.mcap"
    settings = ("source.uri=own_parts:NumpySource:5", f"recording.path={path}")
    report = assemble.build(load_config(None, settings)).run()
    assert (report.incomplete, len(RunReader(path))) == ("", 5 + 1)


def test_an_image_that_is_none_is_refused():
    done = call("run", "own_parts:FloatSource", "--fast")
    assert done.exit_code == 2
    assert "source own_parts:FloatSource: image is float64 (240, 320); it must be uint8" in done.output
