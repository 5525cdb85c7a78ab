"""The perceiver `volume` on a short simulated approach, against its ground truth."""

import numpy as np
import pytest
from msgspec.structs import replace

from haptigraph.config import Config
from haptigraph.errors import BadInput
from haptigraph.geometry import Polyline, height_on_polyline, height_on_surface
from haptigraph.messages import Capture
from haptigraph.perception.volume.perceiver import VolumePerceiver
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.oct.phantom import open_phantom


class Played:
    """All volumes of a phantom, what the perceiver found in them, and the truth."""

    def __init__(self, scenario: str) -> None:
        phantom = open_phantom(scenario)
        self.registration = parse_registration(phantom.registration, "phantom")
        self.captures, self.tips_mm = [], []
        while (moment := phantom.advance()) is not None:
            stamp_ns = round(moment.time_s * 1e9)
            self.captures.append(Capture(len(self.captures), stamp_ns, moment.image, truth=moment.truth))
            self.tips_mm.append(phantom.truth.needle and phantom.truth.needle.tip_mm)
        self.observations = self.observe(self.captures)

    def observe(self, captures, registration=None):
        perceive = VolumePerceiver(registration or self.registration, Config().perception)
        return [perceive(capture) for capture in captures]


@pytest.fixture(scope="module")
def played(quick_volume):
    return Played(quick_volume)


def place(point):
    return np.array((*point.at_mm, point.z_mm))


def test_the_tip_is_found_in_three_dimensions(played):
    errors_mm = [
        np.linalg.norm(place(seen.found["needle_tip"]) - tip_mm)
        for seen, tip_mm in zip(played.observations, played.tips_mm, strict=True)
        if "needle_tip" in seen.found
    ]
    visible = [capture for capture in played.captures if capture.truth.visible]
    assert len(errors_mm) >= 0.5 * len(visible) > 8
    assert np.median(errors_mm) < 0.03 and max(errors_mm) < 0.12


def test_no_needle_is_reported_where_there_is_none(played):
    for capture, seen in zip(played.captures, played.observations, strict=True):
        if not capture.truth.visible:
            assert "needle_line" not in seen.found
    assert not all(capture.truth.visible for capture in played.captures)


def test_surfaces_lie_where_they_are_below_the_tip(played):
    errors_mm = {"ilm": [], "rpe": []}
    for capture, seen in zip(played.captures, played.observations, strict=True):
        if "needle_tip" in seen.found:
            tip = seen.found["needle_tip"]
            for name, errors in errors_mm.items():
                true = capture.truth.others[name]
                assert isinstance(true, Polyline)
                at_mm = height_on_surface(tip.at_mm[0], tip.z_mm, seen.found[name])
                errors.append(abs(at_mm - height_on_polyline(tip.at_mm[0], true)))
    for errors in errors_mm.values():
        assert len(errors) > 8 and np.median(errors) < 0.015


def test_the_target_lies_between_the_surfaces_at_its_share(played):
    share = played.registration.target_share
    found = played.observations[0].found
    between = (found[name].grid_mm[2] for name in ("ilm", "rpe", "target_layer"))
    ilm, rpe, target = between
    assert np.allclose(target, (1 - share) * ilm + share * rpe, atol=2e-6)


def test_the_tip_ahead_is_where_it_moves_and_less_certain_than_the_tip(played):
    moving = [seen for seen in played.observations if "needle_tip" in seen.found]
    assert all("needle_tip_ahead" in seen.found for seen in moving)
    ahead_mm = [place(seen.found["needle_tip_ahead"]) - place(seen.found["needle_tip"]) for seen in moving]
    assert np.mean(ahead_mm, axis=0)[1] < -0.01  # it descends throughout
    sds = [seen.sd_mm["needle_tip_ahead"] for seen in moving]
    assert sds[0] > sds[-1] > 0.01


def test_a_tip_that_is_lost_is_still_expected_but_never_without_its_shaft(played):
    lost = [seen for seen in played.observations if "needle_tip" not in seen.found]
    expected = [seen for seen in lost if "needle_tip_ahead" in seen.found]
    assert expected and all("needle_line" in seen.found for seen in expected)
    assert any("needle_line" not in seen.found for seen in lost)


def test_after_a_volume_without_tip_its_motion_is_less_certain(played):
    both = zip(played.captures, played.observations, strict=True)
    moving = [capture for capture, seen in both if "needle_tip" in seen.found][:6]
    dark = replace(moving[4], image=np.zeros_like(moving[4].image))
    seen, whole = played.observe([*moving[:4], dark, moving[5]]), played.observe(moving)
    assert "needle_line" not in seen[4].found and "needle_tip_ahead" not in seen[4].found
    assert seen[5].sd_mm["needle_tip_ahead"] > whole[5].sd_mm["needle_tip_ahead"]


def test_a_mirrored_volume_gives_the_same_places(played):
    capture = next(
        c for c, s in zip(played.captures, played.observations, strict=True) if "needle_tip" in s.found
    )
    text = played.registration.text.replace("[image]", "[image]\nmirrored = true")
    mirrored = played.registration.checked_volume(capture.image)[:, :, ::-1].reshape(capture.image.shape)
    (seen,) = played.observe([replace(capture, image=mirrored)], parse_registration(text, "mirrored"))
    (expected,) = played.observe([capture])
    assert seen == expected


def test_other_images_are_refused(played):
    with pytest.raises(BadInput, match="the registration is for"):
        played.observe([Capture(0, 0, np.zeros((192, 128), np.uint8))])
