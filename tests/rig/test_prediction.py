"""The registration that a design predicts, and its standard deviations."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.registration.loading import parse_camera_registration
from haptigraph.registration.text import registration_text
from haptigraph.rig.description import Tolerances, load_rig, parse_rig
from haptigraph.rig.prediction import Angles, observe, predict, predicted_anatomy
from haptigraph.rig.view import as_designed, drawn

RIGS = sorted((Path(__file__).parents[2] / "rig").glob("*.toml"))
D405 = next(file for file in RIGS if file.stem == "d405")

degrees, sds = st.floats(-60, 60), st.floats(0.01, 5)
measurements = st.lists(st.tuples(st.integers(0, 2), degrees, sds), max_size=6)


def turned_and_printed(roll_sd_deg: float, print_sd_deg: float) -> Angles:
    """Angles of eyes that are turned as a whole, with an independent error of each print."""
    return Angles(np.array([-36.0, 36.0, 9.0]), roll_sd_deg**2 + print_sd_deg**2 * np.eye(3))


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


@pytest.mark.parametrize("file", RIGS, ids=lambda file: file.stem)
def test_angles_are_those_of_the_design_and_vary_by_the_eyes_turn_and_the_print(file):
    rig = load_rig(file)
    angles, eye = predict(rig).angles, rig.eye
    sign = -1 if rig.mirrored else 1
    print_deg = math.degrees(rig.tolerances.print_mm / (eye.diameter_mm / 2))

    assert angles.mean_deg == pytest.approx(
        [*(sign * each for each in eye.trocars_deg), -sign * eye.target_deg]
    )
    by_hand = turned_and_printed(float(predict(rig).sd.roll_deg[0]), print_deg)
    assert angles.cov_deg2 == pytest.approx(by_hand.cov_deg2, rel=0.06)


@given(sds, sds, degrees, sds)
def test_one_angle_measured_is_the_inverse_variance_weighted_mean(roll_sd_deg, print_sd_deg, at_deg, sd_deg):
    prior = turned_and_printed(roll_sd_deg, print_sd_deg)
    weights = 1 / prior.sd_deg[1] ** 2, 1 / sd_deg**2

    posterior = prior.given([(1, at_deg, sd_deg)])

    mean_deg = (weights[0] * prior.mean_deg[1] + weights[1] * at_deg) / sum(weights)
    assert posterior.mean_deg[1] == pytest.approx(mean_deg, abs=1e-6)
    assert posterior.sd_deg[1] == pytest.approx(sum(weights) ** -0.5, rel=1e-6)
    shared = roll_sd_deg**2 / (roll_sd_deg**2 + print_sd_deg**2)
    moved_deg = posterior.mean_deg - prior.mean_deg
    assert moved_deg[[0, 2]] == pytest.approx(shared * moved_deg[1], abs=1e-6)


@given(sds, sds, measurements)
def test_measured_angles_give_the_least_squares_estimate_in_any_order(roll_sd_deg, print_sd_deg, measured):
    """Every unknown is solved for at once: the turn of the eye, and the error of each print."""
    rows = [[1 / roll_sd_deg, 0, 0, 0], *(np.eye(4)[1:] / print_sd_deg)]
    prior, right = turned_and_printed(roll_sd_deg, print_sd_deg), [0.0] * 4
    for number, at_deg, sd_deg in measured:
        rows.append((np.eye(4)[0] + np.eye(4)[number + 1]) / sd_deg)
        right.append((at_deg - prior.mean_deg[number]) / sd_deg)
    roll, *prints = np.linalg.lstsq(np.array(rows), np.array(right))[0]

    posterior, reverse = prior.given(measured), prior.given(measured[::-1])

    assert posterior.mean_deg == pytest.approx(prior.mean_deg + roll + np.array(prints), abs=1e-3)
    assert reverse.mean_deg == pytest.approx(posterior.mean_deg, abs=1e-3)
    assert np.all(posterior.sd_deg <= prior.sd_deg + 1e-9)


@given(degrees, sds)
def test_a_perfect_prior_gives_the_prior_and_a_perfect_picture_the_picture(at_deg, sd_deg):
    exact, loose = turned_and_printed(0.0, 0.0), turned_and_printed(1.0, 0.5)

    assert exact.given([(0, at_deg, sd_deg)]).mean_deg == pytest.approx(exact.mean_deg)
    assert loose.given([(0, at_deg, 1e-6)]).mean_deg[0] == pytest.approx(at_deg, abs=1e-6)
    assert loose.given([]).mean_deg == pytest.approx(loose.mean_deg)
