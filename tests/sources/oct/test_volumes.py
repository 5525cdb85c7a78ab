"""Volumes become one capture each, with all three scales stated."""

import cv2
import numpy as np
import pytest
from helpers import drain
from oct_files import heidelberg_vol

from haptigraph.assemble import open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import load_config
from haptigraph.errors import BadInput
from haptigraph.registration.loading import parse_registration

RNG = np.random.default_rng(6)
VOLUMES = RNG.integers(0, 256, (3, 5, 32, 24)).astype(np.uint8)  # (volume, slice, row, column)
SCALE = ("source.axial_mm_per_px=0.0033", "source.lateral_mm_per_px=0.0078", "source.slice_mm=0.05")


def opened(path, *settings):
    config = load_config(None, (f'source.uri="oct:{path}"', *settings))
    return open_source(config, VirtualClock())


def error_of(path, *settings):
    with pytest.raises(BadInput) as raised:
        drain(opened(path, *settings))
    assert "\n" not in str(raised.value)
    return str(raised.value)


def registered(source):
    return parse_registration(source.registration, "source")


@pytest.fixture
def arrays(tmp_path):
    for number, volume in enumerate(VOLUMES):
        np.savez(tmp_path / f"v{9 + number}.npz", data=volume, pos=np.zeros(6))
    return tmp_path


def test_a_folder_of_arrays_is_played_volume_by_volume_in_natural_order(arrays):
    source = opened(arrays, *SCALE, "source.rate_hz=4")
    captures = drain(source)
    assert [capture.stamp_ns for capture in captures] == [0, 250_000_000, 500_000_000]
    registration = registered(source)
    assert registration.voxel_mm == (0.0033, 0.05, 0.0078)
    for capture, volume in zip(captures, VOLUMES, strict=True):
        assert np.array_equal(registration.checked_volume(capture.image), volume.transpose(1, 0, 2))


@pytest.mark.parametrize("axes", ["rows,slices,columns", "rows,columns,slices"])
def test_the_axes_of_an_array_are_as_stated(tmp_path, axes):
    names = "slices", "rows", "columns"
    stored = VOLUMES[0].transpose([names.index(word) for word in axes.split(",")])
    np.save(tmp_path / "v.npy", np.asfortranarray(stored))
    source = opened(tmp_path / "v.npy", *SCALE, f'source.volume_axes="{axes}"')
    (capture,) = drain(source)
    assert np.array_equal(registered(source).checked_volume(capture.image), VOLUMES[0].transpose(1, 0, 2))


def test_a_stack_of_tiff_is_a_volume(tmp_path):
    cv2.imwritemulti(str(tmp_path / "v.tif"), list(VOLUMES[0]))
    (capture,) = drain(opened(tmp_path / "v.tif", *SCALE))
    assert np.array_equal(capture.image, np.concatenate(list(VOLUMES[0]), axis=1))


def test_the_b_scans_of_arrays_are_played_as_a_sequence(arrays):
    captures = drain(opened(arrays, *SCALE[:2], "source.volume_as_sequence=true"))
    assert np.array_equal([capture.image for capture in captures], VOLUMES.reshape(-1, 32, 24))


def test_dicom_states_the_distance_of_its_b_scans(tmp_path):
    files = pytest.importorskip("dicom_files", reason="needs pydicom", exc_type=ImportError)
    from pydicom.dataset import Dataset

    group, measures = Dataset(), Dataset()
    measures.PixelSpacing, measures.SpacingBetweenSlices = [0.0039, 0.0115], 0.06
    group.PixelMeasuresSequence = [measures]
    for name, volume in zip(("b10", "b9"), VOLUMES, strict=False):
        content = files.dicom(volume, SharedFunctionalGroupsSequence=[group])
        files.write(tmp_path / f"{name}.dcm", content)
    source = opened(tmp_path)
    captures = drain(source)
    assert registered(source).voxel_mm == (0.0039, 0.06, 0.0115)
    shown = [capture.image for capture in captures]
    assert np.array_equal(shown, [np.concatenate(list(volume), axis=1) for volume in VOLUMES[1::-1]])


def test_a_vendors_file_states_the_distance_of_its_b_scans(tmp_path):
    pytest.importorskip("eyepy", reason="needs eyepy", exc_type=ImportError)
    source = opened(heidelberg_vol(tmp_path / "cube.vol", VOLUMES[0]))
    assert registered(source).voxel_mm == pytest.approx((0.0039, 0.1, 0.0115))


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (
            {"a": VOLUMES[0], "b": VOLUMES[1]},
            "expected one array of three axes, a volume; found (5, 32, 24), (5,",
        ),
        ({"a": VOLUMES[0, 0]}, "expected one array of three axes, a volume; found (32, 24)"),
        ({"a": VOLUMES[0].astype(np.float32)}, "pixels of type float32"),
        ({"a": np.array([{}], object)}, "not a NumPy file"),
    ],
)
def test_other_arrays_are_rejected(tmp_path, content, problem):
    np.savez(tmp_path / "v.npz", **content)
    message = error_of(tmp_path / "v.npz", *SCALE)
    assert problem in message and "v.npz" in message


def test_a_damaged_file_is_named(arrays):
    (arrays / "v10.npz").write_bytes(b"PK\x03\x04 but no archive")
    assert "v10.npz: not a NumPy file" in error_of(arrays, *SCALE)


def test_volumes_are_neither_cropped_nor_turned(arrays):
    for setting in ("source.crop_px=[0, 0, 16, 16]", "source.rotate_deg=90", "source.mirror=true"):
        assert "volumes can be neither cropped nor turned" in error_of(arrays, *SCALE, setting)


def test_an_implausible_distance_is_rejected(arrays):
    assert "source.slice_mm is 50 mm" in error_of(arrays, *SCALE[:2], "source.slice_mm=50")
