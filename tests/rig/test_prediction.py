"""The registration that a design predicts, and its standard deviations."""

import math
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from haptigraph.registration.loading import parse_camera_registration
from haptigraph.registration.text import registration_text
from haptigraph.rig.description import Tolerances, load_rig, parse_rig
from haptigraph.rig.prediction import observe, predict, predicted_anatomy
from haptigraph.rig.view import as_designed, drawn

RIGS = sorted((Path(__file__).parents[2] / "rig").glob("*.toml"))
D405 = next(file for file in RIGS if file.stem == "d405")


@pytest.mark.parametrize("file", RIGS, ids=lambda file: file.stem)
def test_a_prediction_is_a_valid_registration_of_the_designed_eye(file):
    rig = load_rig(file)
    text = registration_text(predicted_anatomy(rig, observe(rig, as_designed())), "Predicted.")

    registration = parse_camera_registration(text, "prediction")

    eye = rig.eye
    angle, middle_mm = math.radians(eye.trocars_deg[0]), (eye.diameter_mm + eye.wall_mm) / 2
    at_mm = registration.trocar.at_mm
    assert at_mm == pytest.approx((middle_mm * math.sin(angle), middle_mm * math.cos(angle)), abs=1e-3)
    target = math.radians(eye.target_deg)
    x_mm, y_mm = registration.target.at_mm
    assert math.atan2(x_mm, -y_mm) == pytest.approx(target, abs=1e-4)
    assert registration.image.mirrored
    assert len(registration.other_trocars) == 1


def test_standard_deviations_follow_the_tolerances():
    rig = load_rig(D405)
    tolerances = rig.tolerances
    half = Tolerances(*(getattr(tolerances, name) / 2 for name in tolerances.__struct_fields__))

    loose, tight = predict(rig).sd, predict(replace(rig, tolerances=half)).sd

    for name in ("center_px", "radius_px", "roll_deg", "tilt_deg", "target_px", "ports_px", "wall_ratio"):
        assert getattr(tight, name) == pytest.approx(getattr(loose, name) / 2, rel=0.03), name


def test_the_scale_varies_by_focal_length_distance_and_print():
    """By hand: camera and eye along the path, the mirror's shift counted twice at 45 degrees along z and y."""
    rig, sd = load_rig(D405), predict(load_rig(D405)).sd
    tolerances = rig.tolerances
    path_sd_mm = tolerances.position_mm * math.sqrt(1 + 1 + 2)
    by_hand = math.hypot(
        tolerances.focal_percent / 100,
        path_sd_mm / rig.path_mm,
        tolerances.print_mm / (rig.eye.diameter_mm / 2),
    )

    assert sd.radius_px[0] / predict(rig).expected.radius_px[0] == pytest.approx(by_hand, rel=0.05)


def test_the_prediction_is_the_mean_of_what_is_built():
    rig = load_rig(D405)
    prediction, built = predict(rig), observe(rig, drawn(rig, 4000, 99))

    for name in ("center_px", "radius_px", "target_px", "ports_px"):
        mean, sd = getattr(built, name).mean(axis=0), getattr(prediction.sd, name)[0]
        assert np.all(np.abs(mean - getattr(prediction.expected, name)[0]) < 0.1 * sd), name


def test_two_ports_on_one_side_have_two_names():
    rig = parse_rig(
        D405.read_text().replace("[[mirror]]", "[eye]\ntrocars_deg = [50.0, 10.0]\n[[mirror]]"), "rig.toml"
    )

    anatomy = predicted_anatomy(rig, observe(rig, as_designed()))

    assert [(trocar.name, trocar.used) for trocar in anatomy.trocars] == [("right", True), ("right 2", False)]
