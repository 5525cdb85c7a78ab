"""Turned images: rotated by 90-degree steps, and mirrored."""

import cv2
import numpy as np
import pytest
from helpers import drain
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.assemble import open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import load_config
from haptigraph.errors import BadInput
from haptigraph.imaging import UPRIGHT, Turn

TURNS = st.builds(Turn, st.sampled_from((0, 90, 180, 270)), st.booleans())


@given(TURNS, st.integers(2, 9), st.integers(2, 9), st.integers(0, 2**16))
def test_every_turn_can_be_undone_and_keeps_every_pixel(turn, width, height, seed):
    image = np.random.default_rng(seed).integers(0, 255, (height, width, 3), np.uint8)
    turned = turn(image)
    assert turn.size_before_px(turned.shape[1::-1]) == (width, height)
    flipped = Turn(0, turn.mirror)(turned)
    assert (Turn((360 - turn.rotate_deg) % 360)(flipped) == image).all()


def test_rotation_is_clockwise_and_mirroring_comes_after_it():
    image = np.array([[1, 2, 3], [4, 5, 6]], np.uint8)
    assert Turn(90)(image).tolist() == [[4, 1], [5, 2], [6, 3]]
    assert Turn(90, mirror=True)(image).tolist() == [[1, 4], [2, 5], [3, 6]]
    assert UPRIGHT(image) is image


@pytest.fixture
def folder(tmp_path):
    cv2.imwrite(str(tmp_path / "0.png"), np.arange(6, dtype=np.uint8).reshape(2, 3) * 40)
    return tmp_path


def opened(uri, *settings):
    return open_source(load_config(None, (f"source.uri={uri}", *settings)), VirtualClock())


def test_a_source_turns_its_images(folder):
    (plain,) = drain(opened(folder))
    (turned,) = drain(opened(folder, "source.rotate_deg=270", "source.mirror=true"))
    assert (turned.image == Turn(270, mirror=True)(plain.image)).all()
    assert turned.encoded is None  # the file's bytes show another image


def test_what_is_upright_by_itself_is_not_turned(quick_uri, quick_scan):
    for uri in (quick_uri, "teleop", f"phantom:{quick_scan}"):
        with pytest.raises(BadInput, match="brings its own registration, for the images as they are"):
            opened(uri, "source.mirror=true")


@pytest.mark.parametrize("degrees", ["45", "-90", "360"])
def test_only_quarter_turns_are_valid(degrees):
    with pytest.raises(BadInput, match=r"source\.rotate_deg"):
        load_config(None, (f"source.rotate_deg={degrees}",))
