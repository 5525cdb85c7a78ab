"""ILM, RPE and needle in B-scans: simulated ones with ground truth, and real ones if they are available."""

import json
import math

import cv2
import numpy as np
import pytest
from paths import SHARED
from scans.bscans import in_px, line_distance_px, perceiver_of, registration_of, visible_columns_of

from haptigraph.config import PerceptionConfig
from haptigraph.errors import BadInput
from haptigraph.geometry import height_on_polyline
from haptigraph.messages import Capture
from haptigraph.perception.oct.bscan import BscanPerceiver
from haptigraph.sim.oct.scenes import random_scene

REAL = SHARED / "ioct"
SCENES = 24


def shaft_error_deg(truth, observation, image):
    """Angle between the detected and the true shaft in the image."""
    line = observation.found["needle_line"]
    (x, y), (tip_x, tip_y) = image.to_px(line.start_mm), image.to_px(line.end_mm)
    return abs(math.degrees(math.atan2(tip_y - y, tip_x - x)) - truth.needle.angle_deg)


@pytest.fixture(scope="module")
def results():
    """Random scenes with their ground truth and observations."""
    out = []
    for number in range(SCENES):
        scene = random_scene(number, 5)
        perceive, image = perceiver_of(scene)
        scan = scene.take()
        out.append((scene, scan.truth, perceive(Capture(0, 0, scan.image)), image))
    return out


@pytest.mark.parametrize("name", ["ilm", "rpe"])
def test_surfaces_are_accurate_and_complete(results, name):
    errors, visible_columns, detected_columns = [], 0, 0
    for _, truth, observation, image in results:
        rows, lit = getattr(truth, f"{name}_px"), getattr(truth, f"{name}_lit")
        visible = lit & (rows > 4) & (rows < 490)
        visible_columns += visible[::7].sum()
        if name not in observation.found:
            continue
        x, y = in_px(observation.found, name, image)
        is_visible = visible_columns_of(observation, name, x, image)
        columns = np.clip(np.rint(x[is_visible]).astype(int), 0, len(rows) - 1)
        counted = visible[columns]
        detected_columns += counted.sum()
        errors += np.abs(y[is_visible] - rows[columns])[counted].tolist()
    assert detected_columns > 0.85 * visible_columns
    assert np.median(errors) <= 1.5
    assert np.percentile(errors, 95) <= 4


@pytest.mark.parametrize(("number", "seed"), [(177, 90001), (9, 95001), (86, 95001), (10, 95001)])
def test_in_haze_the_ilm_is_neither_on_the_rpe_nor_at_the_hazes_edge(number, seed):
    scene = random_scene(number, seed, haze_db=9.0)
    perceive, image = perceiver_of(scene)
    scan = scene.take()
    observation = perceive(Capture(0, 0, scan.image))
    x, y = in_px(observation.found, "ilm", image)
    columns = np.clip(np.rint(x).astype(int), 0, len(scan.truth.ilm_px) - 1)
    is_visible = visible_columns_of(observation, "ilm", x, image)
    assert is_visible.sum() >= 15
    assert np.abs(y - scan.truth.ilm_px[columns])[is_visible].max() < 12
    assert "rpe" in observation.found


def test_the_needle_is_accurate_without_false_detections(results):
    angles, tips = [], []
    for _, truth, observation, image in results:
        if truth.needle is None:
            assert "needle_tip" not in observation.found
            continue
        if "needle_tip" not in observation.found:
            continue
        angles.append(shaft_error_deg(truth, observation, image))
        tips.append(math.dist(image.to_px(observation.found["needle_tip"].at_mm), truth.needle.tip_px))
    needles = [truth for _, truth, _, _ in results if truth.needle and truth.needle.tip_px[1] > 40]
    assert len(tips) >= len(needles) - 1
    assert np.percentile(angles, 95) <= 0.5
    assert np.median(tips) <= 2
    assert np.percentile(tips, 90) <= 5


def test_tissue_in_line_with_a_short_shaft_does_not_rotate_it():
    errors_deg = []
    for number in (1, 4, 12, 18):
        scene = random_scene(number, 23, vessels=8, vessel_db=14.0)
        perceive, image = perceiver_of(scene)
        scan = scene.take()
        errors_deg.append(shaft_error_deg(scan.truth, perceive(Capture(0, 0, scan.image)), image))
    assert max(errors_deg) <= 0.5


def test_inside_tissue_the_tip_is_less_certain(results):
    sds_px = {"above": [], "inside": []}
    for scene, _, observation, _ in results:
        if observation.certainty and scene.place in sds_px:
            sds_px[scene.place].append(observation.certainty.tip_sd_mm / scene.scan.axial_mm_per_px)
    assert np.median(sds_px["inside"]) > 1.3 * np.median(sds_px["above"])


def test_layers_are_between_the_surfaces_and_the_retina_is_the_ilm(results):
    for _, _, observation, image in results:
        found = observation.found
        assert ("retina_surface" in found) == ("ilm" in found)
        assert ("rpe" in found) == ("target_layer" in found) == ("subretinal_space" in found)
        if "rpe" in found:
            assert found["retina_surface"] == found["ilm"]
            x, rpe = in_px(found, "rpe", image)
            ilm = np.interp(x, *in_px(found, "ilm", image))
            assert in_px(found, "target_layer", image)[1] == pytest.approx(ilm + 0.6 * (rpe - ilm))
            assert in_px(found, "subretinal_space", image)[1] == pytest.approx(ilm + 0.9 * (rpe - ilm))


def test_interpolation_below_the_tip_is_marked_and_ends_in_the_shadow():
    scene = random_scene(3, 8, place="above", vessels=0, haze_db=-20.0)
    perceive, image = perceiver_of(scene)
    scan = scene.take()
    observation, needle = perceive(Capture(0, 0, scan.image)), scan.truth.needle
    x, _ = in_px(observation.found, "ilm", image)
    side = math.copysign(1, needle.along_px[0])
    beyond = side * (needle.tip_px[0] - x)
    assert 0 < beyond.max() < 25  # extended below the tip, but no further into the shadow
    parts = [sorted(image.to_px((end, 0.0))[0] for end in part) for part in observation.interpolated["ilm"]]
    assert any(left - 1e-6 <= x[beyond.argmax()] <= right + 1e-6 for left, right in parts)


def test_a_column_half_in_the_needles_shadow_shows_no_surface(results):
    found = [(seen, image) for *_, seen, image in results if "needle_tip" in seen.found]
    for seen, image in found:
        edge_x = image.to_px(seen.found["needle_tip"].at_mm)[0]
        for name in {"ilm", "rpe"} & set(seen.found):
            x, _ = in_px(seen.found, name, image)
            half_px = np.diff(x).min() / 2
            is_visible = visible_columns_of(seen, name, x, image)
            assert not (np.abs(x[is_visible] - edge_x) < half_px - 1).any()
    assert len(found) > SCENES / 2


def test_interpolation_across_a_vessels_shadow_is_marked():
    scene = random_scene(5, 8, place="none", vessels=3, vessel_db=40.0)
    perceive, image = perceiver_of(scene)
    scan = scene.take()
    observation = perceive(Capture(0, 0, scan.image))
    parts = observation.interpolated.get("rpe", ())
    assert parts
    x, y = in_px(observation.found, "rpe", image)
    rows = np.interp(x, np.arange(len(scan.truth.rpe_px)), scan.truth.rpe_px)
    assert np.abs(y - rows).max() < 12


def test_even_a_bright_ghost_is_rejected():
    for number in range(4):
        scene = random_scene(number, 12, place="above", ghost_db=1.0, tip_x_mm=0.0)
        perceive, image = perceiver_of(scene)
        scan = scene.take()
        tip = perceive(Capture(0, 0, scan.image)).found.get("needle_tip")
        assert tip is not None
        assert (
            math.dist(image.to_px(tip.at_mm), scan.truth.needle.tip_px) < 15
        )  # the ghost is 100 px away and more


@pytest.mark.parametrize("width", [380, 512, 700])
def test_flipping_the_image_flips_the_result(width):
    scene = random_scene(2, 9, size_px=(width, 512))
    perceive, image = perceiver_of(scene)
    image_of_scene = scene.take().image
    one = perceive(Capture(0, 0, image_of_scene)).found
    other = perceive(Capture(0, 0, np.ascontiguousarray(image_of_scene[:, ::-1]))).found
    (x, y), (other_x, other_y) = (image.to_px(found["needle_tip"].at_mm) for found in (one, other))
    assert other_x == pytest.approx(width - 1 - x, abs=2)
    assert other_y == pytest.approx(y, abs=3)


def test_a_mirrored_scan_is_flipped():
    scene = random_scene(2, 9)
    scan = scene.scan
    size = scan.width_px, scan.height_px, scan.axial_mm_per_px, scan.lateral_mm_per_px
    capture = Capture(0, 0, scene.take().image)
    plain, mirrored = (
        BscanPerceiver(registration_of(*size, mirrored), PerceptionConfig())(capture).found
        for mirrored in ("false", "true")
    )
    assert mirrored["needle_tip"].at_mm[0] == pytest.approx(-plain["needle_tip"].at_mm[0])
    assert mirrored["ilm"].points_mm[0][0] == pytest.approx(-plain["ilm"].points_mm[0][0])


@pytest.mark.parametrize("grey", [0, 60, 255])
def test_nothing_is_detected_in_blank_and_noise_images(grey):
    perceive = BscanPerceiver(registration_of(300, 260, 0.0033, 0.0078), PerceptionConfig())
    rng = np.random.default_rng(1)
    empty = np.full((260, 300), grey, np.uint8)
    noise = np.clip(rng.normal(grey, 30, (260, 300)), 0, 255).astype(np.uint8)
    for image in (empty, noise, cv2.cvtColor(noise, cv2.COLOR_GRAY2BGR)):
        assert perceive(Capture(0, 0, image)).found == {}


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (
            np.zeros((5, 260, 300), np.uint8),
            "expected one B-scan, (rows, columns), found an array of 5 x 260 x 300",
        ),
        (np.zeros((260, 300), np.uint16), "expected a B-scan of 8 bits, grey 0 to 255, found uint16 values"),
        (np.zeros((300, 260), np.uint8), "image is 260 x 300 px, but the registration is for 300 x 260 px"),
        (None, "image is no image, but the registration is for 300 x 260 px"),
    ],
)
def test_an_invalid_b_scan_is_refused(image, message):
    perceive = BscanPerceiver(registration_of(300, 260, 0.0033, 0.0078), PerceptionConfig())
    with pytest.raises(BadInput) as refused:
        perceive(Capture(0, 0, image))
    assert message in str(refused.value)


# --- real B-scans: their scale is unknown; a Leica's is assumed, which affects thicknesses only


class Real:
    """A real B-scan, resampled, with its labels and what was found, all in the label's pixels."""

    def __init__(self, name, factor):
        labels = {one["image"]: one for one in json.loads((REAL / "labels.json").read_text())}
        self.labels = labels[name]
        image = cv2.imread(str(REAL / name), cv2.IMREAD_GRAYSCALE)
        height, width = image.shape
        size = round(factor * width), round(factor * height)
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC)
        registration = registration_of(*size, 0.0033 * height / size[1], 0.0078 * width / size[0])
        self.observation = BscanPerceiver(registration, PerceptionConfig())(Capture(0, 0, image))
        self.image = registration_of(width, height, 0.0033, 0.0078).image


@pytest.fixture(params=["bscan_1.png", "bscan_3.png"])
def real(request):
    if not (REAL / request.param).is_file():
        pytest.skip(f"{REAL} is not here")
    return Real(request.param, 1.0)


def test_in_real_scans_the_line_runs_along_the_shaft(real):
    line = real.observation.found["needle_line"]
    (x, y), (end_x, end_y) = real.image.to_px(line.start_mm), real.image.to_px(line.end_mm)
    angle_deg = math.degrees(math.atan2(end_y - y, end_x - x))
    assert angle_deg == pytest.approx(real.labels["shaft_angle_from_x_axis_deg"], abs=0.5)
    slope, offset = real.labels["shaft_line_x_of_y"]
    for row in range(0, real.labels["shaft"][1][1], 10):
        assert line_distance_px(real.observation, real.image, (slope * row + offset, row)) <= 1


@pytest.mark.parametrize("name", ["ilm", "rpe"])
def test_in_real_scans_surfaces_match_their_labels(real, name):
    x, y = in_px(real.observation.found, name, real.image)
    is_visible = visible_columns_of(real.observation, name, x, real.image)
    rows = np.array([math.nan if row is None else row for row in real.labels[f"{name}_y"]])
    labelled = rows[np.rint(x[is_visible]).astype(int)]
    errors = np.abs(y[is_visible] - labelled)
    assert np.isnan(errors).mean() < 0.05  # no detections without labels
    assert np.nanmedian(errors) <= 2


@pytest.mark.parametrize("factor", [0.7, 1.0, 1.5, 2.0])
@pytest.mark.parametrize(("name", "within_px"), [("bscan_1.png", 3), ("bscan_3.png", 10)])
def test_in_real_scans_of_any_resolution_the_tip_matches_its_label(name, within_px, factor):
    if not (REAL / name).is_file():
        pytest.skip(f"{REAL} is not here")
    real = Real(name, factor)
    off_px = math.dist(real.image.to_px(real.observation.found["needle_tip"].at_mm), real.labels["tip"])
    assert off_px <= within_px
    line, tip = real.observation.found["needle_line"], real.observation.found["needle_tip"]
    assert math.dist(line.end_mm, tip.at_mm) > 0.03  # the bevel's point is beside the shaft's line


@pytest.mark.parametrize("factor", [0.7, 1.5, 2.0])
@pytest.mark.parametrize("name", ["bscan_1.png", "bscan_3.png"])
def test_real_scans_of_any_resolution_have_the_same_lengths(name, factor):
    if not (REAL / name).is_file():
        pytest.skip(f"{REAL} is not here")
    lengths = []
    for found in (Real(name, one).observation.found for one in (1.0, factor)):
        x_mm, y_mm = found["needle_tip"].at_mm
        floor_mm = height_on_polyline(x_mm, found["rpe"])
        lengths.append((y_mm - floor_mm, height_on_polyline(x_mm, found["ilm"]) - floor_mm))
    assert lengths[1] == pytest.approx(lengths[0], rel=0.05)
