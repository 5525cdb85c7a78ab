import json

import cv2
import msgspec
import pytest
from helpers import make_step, needle
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.analysis.evaluation.angle_noise import HeldDepth
from haptigraph.analysis.evaluation.cramer_rao import AngleBound
from haptigraph.analysis.evaluation.ground_truth import TruthRow
from haptigraph.analysis.evaluation.report import sweep_object, sweep_text
from haptigraph.analysis.evaluation.sweep import (
    perceivers_to_compare,
    play,
    shaft_error_deg,
    sweep,
    true_rows,
)
from haptigraph.analysis.evaluation.sweep_figure import sweep_figure
from haptigraph.config import load_config
from haptigraph.geometry import Polyline, Segment
from haptigraph.messages import Observation, Truth
from haptigraph.projection import ImageGeometry
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenes import random_scene
from haptigraph.sim.sweep_scenes import SWEEP_CONDITIONS

SMALL = (480, 270)
HALVED = (720, 408)  # large enough for a registration at half of it
CONFIG = load_config(None, ("perception.alpha=1",))


def true_registration(phantom):
    return parse_registration(phantom.true_registration, "the true registration")


class Certain:
    """Reports the same needle in every image."""

    entities = frozenset(("needle_tip", "needle_line"))
    entities_with_sd = frozenset()
    images = "eye"

    def __init__(self, registration, config):
        self._anatomy = registration.anatomy

    def __call__(self, capture):
        return Observation(capture.stamp_ns, self._anatomy | needle((5.0, 10.0), (0.0, 0.0)))

    def reset(self):
        pass


class Blind(Certain):
    def __call__(self, capture):
        return Observation(capture.stamp_ns, dict(self._anatomy))


@pytest.fixture(scope="module")
def swept():
    with pytest.MonkeyPatch.context() as patch:
        for name in ("Certain", "Blind"):
            patch.setitem(assemble.PERCEIVERS, name.lower(), f"{__name__}:{name}")
        return sweep(len(SWEEP_CONDITIONS), ["threshold", "certain", "blind"], CONFIG, seed=3, size_px=HALVED)


HELD = [
    HeldDepth(
        depth,
        {"threshold": noise, "certain": 0.01, "blind": None},
        AngleBound(0.1 / depth, free, 0.01, 0.02),
        {"threshold": 0.01, "certain": 0.0, "blind": None},
    )
    for depth, noise, free in ((1.0, None, float("inf")), (5.0, 0.2, 0.1), (12.0, 0.1, 0.02))
]


def test_every_condition_is_scored_and_all_are_pooled(swept):
    scores = swept.scores()
    assert list(scores) == ["threshold", "certain", "blind"]
    for rows in scores.values():
        assert list(rows) == ["all", *SWEEP_CONDITIONS]
        assert rows["all"]["images"] == sum(rows[name]["images"] for name in SWEEP_CONDITIONS)
        assert rows["registration"]["state_agreement"] is None


def test_a_perceiver_that_always_reports_a_needle_has_false_detections(swept):
    scores = swept.scores()["certain"]["all"]
    assert scores["detection_rate"] == 1.0
    assert scores["false_detections"] > 30
    assert scores["tip_error_px"]["median"] > 5


def test_a_perceiver_that_reports_no_needle_has_no_false_detections_but_misses_all(swept):
    scores = swept.scores()["blind"]["all"]
    assert scores["detection_rate"] == 0.0
    assert scores["false_detections"] == scores["wrong_contact_images"] == 0
    assert scores["tip_error_px"] == {"median": None, "p95": None}


def test_the_reference_method_finds_most_needles(swept):
    scores = swept.scores()["threshold"]["all"]
    assert scores["detection_rate"] > 0.8
    assert scores["angle_error_deg"]["deep"]["median"] < 1.0


def test_the_same_seed_gives_the_same_scores():
    one, other = (sweep(2, ["threshold"], CONFIG, seed=5, size_px=SMALL) for _ in range(2))
    assert one == other


def test_progress_is_reported():
    progress = []
    sweep(1, ["threshold"], CONFIG, size_px=SMALL, progress=lambda *now: progress.append(now))
    assert progress == [("playing scenes", 0, 1), ("playing scenes", 1, 1)]


def test_the_true_states_follow_from_the_rules_and_the_true_needle(procedure):
    phantom = Phantom(random_scene(11, 3, size_px=SMALL).scenario)
    moments = [moment for _, moment in play(phantom)]
    rows = true_rows([moment.truth for moment in moments], true_registration(phantom), procedure)
    for row, moment in zip(rows, moments, strict=True):
        assert row.visible == moment.truth.visible
        assert (row.state == "unknown") == (not row.visible)
        assert (row.state == "outside_eye") == (row.visible and not row.inside)


def test_the_shaft_is_compared_in_the_image():
    image = ImageGeometry((100.0, 100.0), 0.1, mirrored=False)
    moved = replace(image, center_px=(103.0, 98.0))  # a registration error does not rotate the shaft
    found = needle(moved.to_mm((50.0, 50.0)), moved.to_mm((50.0, 90.0)))
    step = replace(make_step(stamp_ns=0), observation=Observation(0, found))
    row = TruthRow(True, True, (50.0, 90.0), 4.0, 0.0, "any")
    assert shaft_error_deg(step, row, moved, (50.0, 50.0)) == pytest.approx(0.0, abs=1e-9)
    assert shaft_error_deg(step, row, moved, (40.0, 50.0)) == pytest.approx(14.036, abs=0.001)
    assert shaft_error_deg(step, replace(row, tip_px=None), moved, (40.0, 50.0)) is None
    without = replace(step, observation=Observation(0, {}))
    assert shaft_error_deg(without, row, moved, (40.0, 50.0)) is None


def test_available_perceivers_are_compared(monkeypatch):
    assert "threshold" in perceivers_to_compare()
    monkeypatch.setitem(assemble.PERCEIVERS, "tracker", "some:Tracker")
    assert perceivers_to_compare() == ["threshold", "tracker"]


def test_the_object_is_json_and_the_text_has_a_line_per_condition(swept):
    decoded = json.loads(msgspec.json.encode(sweep_object(swept, HELD)))
    assert set(decoded) == {"scenes", "seed", "perceivers", "angle_noise"}
    bounds = decoded["angle_noise"][0]["bound_deg"]
    assert bounds == {"inside": 0.1, "inside_pivot_free": None, "both": 0.01, "both_pivot_free": 0.02}
    assert decoded["angle_noise"][1]["noise_deg"]["threshold"] == 0.2
    lines = sweep_text(swept, HELD).splitlines()
    assert any("5 mm" in line for line in lines)
    for name in (*SWEEP_CONDITIONS, "bound both rcm free"):
        assert any(line.strip().startswith(name) for line in lines), name
    assert max(map(len, lines)) <= 100


def test_scenes_without_a_needle_have_no_figures_of_one():
    swept = sweep(2, ["threshold"], CONFIG, size_px=SMALL)  # of the second, too, no needle is in the eye
    scores = swept.scores()["threshold"]
    assert scores["plain"]["needle_images"] == 0 < scores["plain"]["images"]
    held = [replace(each, noise_deg={"threshold": None}) for each in HELD]
    row, _ = (line for line in sweep_text(swept, held).splitlines() if line.startswith("  plain"))
    cells = row.split()
    assert cells[:4] == ["plain", "24", "no", "needle"]
    assert (cells[7], cells[9]) == ("n/a", "n/a")  # states, missed contacts


def test_a_sweep_is_drawn(swept, tmp_path):
    sweep_figure(swept, HELD, tmp_path / "sweep.png")
    assert cv2.imread(str(tmp_path / "sweep.png")).shape[1] > 1200


def test_the_true_state_depends_on_a_deformed_retina(procedure):
    phantom = Phantom(random_scene(11, 3, size_px=SMALL).scenario)
    x, y = phantom.eye.target_mm
    near = Truth(True, True, (0.0, 0.0), (0.96 * x, 0.96 * y), 20.0, 0.0)
    farther = Polyline(tuple((1.1 * x, 1.1 * y) for x, y in phantom.eye.retina_mm))
    truths = [near, replace(near, others={"retina_surface": farther})]
    states = [row.state for row in true_rows(truths, true_registration(phantom), procedure)]
    assert states[0] == "target_hit"
    assert states[1].endswith("retinal_approach")


def test_the_true_state_of_an_image_is_not_held_from_another(procedure):
    phantom = Phantom(random_scene(11, 3, size_px=SMALL).scenario)
    x, y = phantom.eye.target_mm
    near, far = (Truth(True, True, (0.0, 0.0), (at * x, at * y), 20.0, 0.0) for at in (0.96, 0.8))
    states = tuple(replace(one, hold_ms=300.0) for one in procedure.states)
    rows = true_rows([near, far], true_registration(phantom), replace(procedure, states=states))
    assert rows[0].state == "target_hit" and rows[1].state.endswith("retinal_approach")


def test_the_angle_is_that_of_the_shaft_even_if_the_tip_is_beside_it(procedure):
    phantom = Phantom(random_scene(11, 3, size_px=SMALL).scenario)
    trocar_mm, target_mm = phantom.eye.trocar_mm, phantom.eye.target_mm
    axis_mm = tuple((start + end) / 2 for start, end in zip(trocar_mm, target_mm, strict=True))
    beside = Truth(True, True, (0.0, 0.0), (axis_mm[0] + 0.5, axis_mm[1]), 12.0, 0.0)
    truths = [beside, replace(beside, others={"needle_line": Segment(trocar_mm, axis_mm)})]
    states = [row.state for row in true_rows(truths, true_registration(phantom), procedure)]
    assert states == ["misaligned_intraocular_navigation", "aligned_intraocular_navigation"]
