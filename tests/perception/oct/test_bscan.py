"""ILM, RPE and needle in B-scans: simulated ones with their truth, and real ones where they lie beside the checkout."""

import json
import math

import cv2
import numpy as np
import pytest
from paths import SHARED

from haptigraph.config import PerceptionConfig
from haptigraph.errors import BadInput
from haptigraph.messages import Capture
from haptigraph.perception.oct.bscan import BscanPerceiver
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.oct.scenes import random_scene

REAL = SHARED / "ioct"
SCENES = 24


def registration_of(width, height, axial_mm, lateral_mm, mirrored="false"):
    return parse_registration(
        f"format = 1\n[image]\nwidth = {width}\nheight = {height}\nmirrored = {mirrored}\n[scale]\n"
        f"axial_mm_per_px = {axial_mm}\nlateral_mm_per_px = {lateral_mm}\n",
        "registration.toml",
    )


def perceiver_of(scene):
    scan = scene.scan
    registration = registration_of(
        scan.width_px, scan.height_px, scan.axial_mm_per_px, scan.lateral_mm_per_px
    )
    return BscanPerceiver(registration, PerceptionConfig()), registration.image


def in_px(found, name, image):
    return np.array([image.to_px(place) for place in found[name].points_mm]).T


def turn_deg(truth, seen, image):
    """How far the shaft that was seen is turned from the true one."""
    line = seen.found["needle_line"]
    (x, y), (tip_x, tip_y) = image.to_px(line.start_mm), image.to_px(line.end_mm)
    return abs(math.degrees(math.atan2(tip_y - y, tip_x - x)) - truth.needle.angle_deg)


def own_parts(seen, name, x, image):
    """Which columns of a surface were seen themselves."""
    own = np.ones(len(x), bool)
    for part in seen.interpolated.get(name, ()):
        left, right = (image.to_px((end, 0.0))[0] for end in part)
        own &= (x <= left + 1e-6) | (x >= right - 1e-6)
    return own


@pytest.fixture(scope="module")
def looked():
    """Random scenes, what is true of them and what was seen."""
    out = []
    for number in range(SCENES):
        scene = random_scene(number, 5)
        perceive, image = perceiver_of(scene)
        scan = scene.take()
        out.append((scene, scan.truth, perceive(Capture(0, 0, scan.image)), image))
    return out


@pytest.mark.parametrize("name", ["ilm", "rpe"])
def test_surfaces_are_where_they_are(looked, name):
    errors, shown, seen_columns = [], 0, 0
    for _, truth, seen, image in looked:
        rows, lit = getattr(truth, f"{name}_px"), getattr(truth, f"{name}_lit")
        visible = lit & (rows > 4) & (rows < 490)
        shown += visible[::7].sum()
        if name not in seen.found:
            continue
        x, y = in_px(seen.found, name, image)
        own = own_parts(seen, name, x, image)
        columns = np.clip(np.rint(x[own]).astype(int), 0, len(rows) - 1)
        counted = visible[columns]
        seen_columns += counted.sum()
        errors += np.abs(y[own] - rows[columns])[counted].tolist()
    assert seen_columns > 0.85 * shown
    assert np.median(errors) <= 1.5
    assert np.percentile(errors, 95) <= 4


def test_the_needle_is_where_it_is_and_none_is_invented(looked):
    angles, tips = [], []
    for _, truth, seen, image in looked:
        if truth.needle is None:
            assert "needle_tip" not in seen.found
            continue
        if "needle_tip" not in seen.found:
            continue
        angles.append(turn_deg(truth, seen, image))
        tips.append(math.dist(image.to_px(seen.found["needle_line"].end_mm), truth.needle.tip_px))
    needles = [truth for _, truth, _, _ in looked if truth.needle and truth.needle.tip_px[1] > 40]
    assert len(tips) >= len(needles) - 1
    assert np.percentile(angles, 95) <= 0.5
    assert np.median(tips) <= 3


def test_tissue_in_line_with_a_short_shaft_does_not_turn_it():
    turns = []
    for number in (1, 4, 12, 18):
        scene = random_scene(number, 23, vessels=8, vessel_db=14.0)
        perceive, image = perceiver_of(scene)
        scan = scene.take()
        turns.append(turn_deg(scan.truth, perceive(Capture(0, 0, scan.image)), image))
    assert max(turns) <= 0.5


def test_inside_tissue_the_tip_is_told_as_less_certain(looked):
    deviations = {"above": [], "inside": []}
    for scene, _, seen, _ in looked:
        if seen.certainty and scene.place in deviations:
            deviations[scene.place].append(seen.certainty.tip_sd_mm / scene.scan.axial_mm_per_px)
    assert np.median(deviations["inside"]) > 1.3 * np.median(deviations["above"])


def test_layers_lie_between_the_surfaces_and_the_retina_is_the_ilm(looked):
    for _, _, seen, image in looked:
        found = seen.found
        assert ("retina_surface" in found) == ("ilm" in found)
        assert ("rpe" in found) == ("target_layer" in found) == ("subretinal_space" in found)
        if "rpe" in found:
            assert found["retina_surface"] == found["ilm"]
            x, rpe = in_px(found, "rpe", image)
            ilm = np.interp(x, *in_px(found, "ilm", image))
            assert in_px(found, "target_layer", image)[1] == pytest.approx(ilm + 0.6 * (rpe - ilm))
            assert in_px(found, "subretinal_space", image)[1] == pytest.approx(ilm + 0.9 * (rpe - ilm))


def test_what_is_bridged_says_so_and_the_shadow_is_left_alone():
    scene = random_scene(3, 8, place="above", vessels=0, haze_db=-20.0)
    perceive, image = perceiver_of(scene)
    scan = scene.take()
    seen, needle = perceive(Capture(0, 0, scan.image)), scan.truth.needle
    x, _ = in_px(seen.found, "ilm", image)
    side = math.copysign(1, needle.along_px[0])
    beyond = side * (needle.tip_px[0] - x)
    assert 0 < beyond.max() < 25  # on to below the tip, and no further into the shadow
    parts = [sorted(image.to_px((end, 0.0))[0] for end in part) for part in seen.interpolated["ilm"]]
    assert any(left - 1e-6 <= x[beyond.argmax()] <= right + 1e-6 for left, right in parts)


def test_a_vessels_shadow_is_bridged_and_says_so():
    scene = random_scene(5, 8, place="none", vessels=3, vessel_db=40.0)
    perceive, image = perceiver_of(scene)
    scan = scene.take()
    seen = perceive(Capture(0, 0, scan.image))
    parts = seen.interpolated.get("rpe", ())
    assert parts
    x, y = in_px(seen.found, "rpe", image)
    rows = np.interp(x, np.arange(len(scan.truth.rpe_px)), scan.truth.rpe_px)
    assert np.abs(y - rows).max() < 12


def test_a_ghost_is_refused_however_bright():
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
def test_left_and_right_make_no_difference(width):
    scene = random_scene(2, 9, size_px=(width, 512))
    perceive, image = perceiver_of(scene)
    picture = scene.take().image
    one = perceive(Capture(0, 0, picture)).found
    other = perceive(Capture(0, 0, np.ascontiguousarray(picture[:, ::-1]))).found
    (x, y), (other_x, other_y) = (image.to_px(found["needle_tip"].at_mm) for found in (one, other))
    assert other_x == pytest.approx(width - 1 - x, abs=2)
    assert other_y == pytest.approx(y, abs=3)


def test_a_mirrored_scan_is_turned_back():
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
def test_nothing_is_found_in_nothing(grey):
    perceive = BscanPerceiver(registration_of(300, 260, 0.0033, 0.0078), PerceptionConfig())
    rng = np.random.default_rng(1)
    empty = np.full((260, 300), grey, np.uint8)
    noise = np.clip(rng.normal(grey, 30, (260, 300)), 0, 255).astype(np.uint8)
    for image in (empty, noise, cv2.cvtColor(noise, cv2.COLOR_GRAY2BGR)):
        assert perceive(Capture(0, 0, image)).found == {}


@pytest.mark.parametrize(
    ("image", "told"),
    [
        (
            np.zeros((5, 260, 300), np.uint8),
            "expected one B-scan, (rows, columns), found a volume of 5 x 260 x 300",
        ),
        (np.zeros((260, 300), np.uint16), "expected a B-scan of 8 bits, grey 0 to 255, found uint16 values"),
        (np.zeros((300, 260), np.uint8), "image is 260 x 300 px, but the registration is for 300 x 260 px"),
        (None, "image is no image, but the registration is for 300 x 260 px"),
    ],
)
def test_what_is_no_such_b_scan_is_refused(image, told):
    perceive = BscanPerceiver(registration_of(300, 260, 0.0033, 0.0078), PerceptionConfig())
    with pytest.raises(BadInput) as refused:
        perceive(Capture(0, 0, image))
    assert told in str(refused.value)


# --- real B-scans: their scale is not known; a Leica's is taken, which decides thicknesses only


@pytest.fixture(params=["bscan_1.png", "bscan_3.png"])
def real(request):
    if not (REAL / request.param).is_file():
        pytest.skip(f"{REAL} is not here")
    labels = {one["image"]: one for one in json.loads((REAL / "labels.json").read_text())}
    image = cv2.imread(str(REAL / request.param), cv2.IMREAD_GRAYSCALE)
    registration = registration_of(image.shape[1], image.shape[0], 0.0033, 0.0078)
    seen = BscanPerceiver(registration, PerceptionConfig())(Capture(0, 0, image))
    return labels[request.param], seen, registration.image


def test_in_real_scans_the_shaft_has_its_angle(real):
    labels, seen, image = real
    line = seen.found["needle_line"]
    (x, y), (tip_x, tip_y) = image.to_px(line.start_mm), image.to_px(line.end_mm)
    angle_deg = math.degrees(math.atan2(tip_y - y, tip_x - x))
    assert angle_deg == pytest.approx(labels["shaft_angle_from_x_axis_deg"], abs=0.5)


@pytest.mark.parametrize("name", ["ilm", "rpe"])
def test_in_real_scans_surfaces_are_where_they_were_labelled(real, name):
    labels, seen, image = real
    x, y = in_px(seen.found, name, image)
    own = own_parts(seen, name, x, image)
    rows = np.array([math.nan if row is None else row for row in labels[f"{name}_y"]])
    labelled = rows[np.rint(x[own]).astype(int)]
    errors = np.abs(y[own] - labelled)
    assert np.isnan(errors).mean() < 0.05  # nothing where nothing was labelled
    assert np.nanmedian(errors) <= 2


def test_in_real_scans_the_tip_is_found_as_far_as_it_can_be_seen(real):
    labels, seen, image = real
    off_px = math.dist(image.to_px(seen.found["needle_tip"].at_mm), labels["tip"])
    assert off_px <= (3 if labels["image"] == "bscan_1.png" else 15)
