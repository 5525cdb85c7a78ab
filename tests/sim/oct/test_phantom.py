"""The OCT phantom, through the same pipeline as every other source."""

import math

import numpy as np
import pytest
from helpers import refuse
from msgspec import to_builtins
from msgspec.structs import replace
from paths import DATA

from haptigraph import assemble
from haptigraph.analysis.metrics.replay import replay
from haptigraph.config import load_config
from haptigraph.errors import BadInput, RenamedKey
from haptigraph.geometry import Point, Polyline, height_on_polyline
from haptigraph.recording.reader import RunReader
from haptigraph.sim.oct.phantom import ScanPhantom, load_scan_scenario, open_phantom
from haptigraph.sim.scenario import scenario_document
from haptigraph.toml_document import Document

IOCT = "subretinal_injection_ioct"


@pytest.fixture(scope="module")
def run(quick_scan, tmp_path_factory):
    """A recorded run of the short approach."""
    path = tmp_path_factory.mktemp("ioct") / "run.mcap"
    settings = (f"source.uri=phantom:{quick_scan}", f"run.procedure={IOCT}", "run.realtime=false")
    assemble.build(load_config(None, (*settings, f'recording.path="{path}"'))).run()
    return path


def test_a_replay_is_identical(run):
    report = replay(run)
    assert report.steps > 60
    assert report.identical == report.steps


def test_states_follow_the_depth(run):
    states = [step.conclusion.state for _, step in RunReader(run).records(images=())]
    order = list(dict.fromkeys(states))
    assert order[:6] == [
        "unknown", "retinal_approach", "ilm_contact", "in_retina", "target_depth", "near_rpe",
    ]  # fmt: skip


def test_depths_agree_with_the_ground_truth_while_the_retina_deforms(run):
    errors, dents = [], []
    for capture, step in RunReader(run).records(images=()):
        truth, tip = capture.truth, step.observation.found.get("needle_tip")
        if truth is None or not truth.visible or not isinstance(tip, Point):
            continue
        rpe = truth.others["rpe"]
        above_um = 1e3 * (truth.tip_mm[1] - height_on_polyline(truth.tip_mm[0], rpe))
        errors.append(step.graph.measures["above_rpe_um"] - above_um * math.cos(math.radians(4)))
        ilm = truth.others["ilm"]
        dents.append(height_on_polyline(1.2, ilm) - height_on_polyline(truth.tip_mm[0], ilm))
    assert len(errors) > 50
    assert np.median(np.abs(errors)) < 12
    assert np.ptp(dents) > 0.05


def test_the_alarm_precedes_contact_with_the_rpe(run):
    alarm_above_um = None
    for capture, step in RunReader(run).records(images=()):
        truth = capture.truth
        if step.conclusion.state == "near_rpe" and alarm_above_um is None and truth is not None:
            alarm_above_um = truth.tip_mm[1] - height_on_polyline(truth.tip_mm[0], truth.others["rpe"])
    assert alarm_above_um is not None
    assert 0.035 < alarm_above_um < 0.12


def test_in_the_shipped_scenario_the_dent_recovers():
    phantom = open_phantom("ioct_approach")
    assert isinstance(phantom, ScanPhantom)
    depths, dents, pierced = [], [], []
    while (moment := phantom.advance(draws=False)) is not None:
        ilm = moment.truth.others["ilm"]
        assert isinstance(ilm, Polyline)
        depths.append(moment.truth.depth_mm)
        dents.append(height_on_polyline(1.9, ilm) - height_on_polyline(-0.35, ilm))
        pierced.append(moment.truth.inside)
    assert len(depths) == phantom.images
    assert min(depths) < -0.4
    assert max(depths) > 0.15
    assert any(pierced) and not pierced[0] and not pierced[-1]
    assert max(dents) - dents[0] > 0.05
    assert dents[-1] == pytest.approx(dents[0], abs=0.01)


def test_a_restarted_scan_phantom_repeats_its_images(quick_scan):
    phantom = open_phantom(quick_scan)
    first = [phantom.advance() for _ in range(12)]
    phantom.restart()
    for before in first:
        again = phantom.advance()
        assert np.array_equal(before.image, again.image)
        assert to_builtins(before.truth) == to_builtins(again.truth)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[scenario]\ndescription = 'x'\n[scan]\n", "missing"),
        ("[scenario]\ndescription = 'x'\nmove = []\n[scan]\n", "move"),
        ("move = []\n[scenario]\ndescription = 'x'\n[scan]\n", "no [[move]]"),
        ("move = []\n[scenario]\ndescription = 'x'\n[scan]\nwidth_px = 9\n", "width_px"),
        ("move = []\n[scenario]\ndescription = 'x'\n[scan]\n[retina]\nthicknes_mm = 0.2\n", "thickness_mm"),
    ],
)
def test_an_invalid_scenario_is_refused(text, message):
    with pytest.raises(BadInput) as refused:
        load_scan_scenario(Document(text, "s.toml"))
    assert message in str(refused.value)
    assert "s.toml" in str(refused.value)


def test_teleoperation_of_b_scan_scenarios_is_refused():
    assert "scan" in scenario_document("ioct_approach").data
    assert "B-scan scenarios are not supported here" in refuse("run", "teleop:ioct_approach")


def test_a_scenario_of_version_0_1_is_read_with_a_warning_for_each_renamed_key():
    document = Document.read(DATA / "v0_1" / "scenarios" / "ioct_approach.toml")
    with pytest.warns(RenamedKey) as warned:
        old = load_scan_scenario(document)
    assert sorted(str(warning.message) for warning in warned) == [
        f"{document.file}, line 18: key 'look' is now called 'appearance'",
        f"{document.file}, line 2: key 'says' is now called 'description'",
    ]
    new = load_scan_scenario(scenario_document("ioct_approach"))
    assert replace(old, about=replace(old.about, description=new.about.description)) == new
    before, after = (ScanPhantom(scenario).advance() for scenario in (old, new))
    assert np.array_equal(before.image, after.image)
