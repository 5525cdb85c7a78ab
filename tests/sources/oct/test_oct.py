import sys
import tomllib

import cv2
import numpy as np
import pytest
from helpers import drain
from oct_files import heidelberg_vol

from haptigraph.assemble import open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import load_config
from haptigraph.errors import BadInput, MissingExtra
from haptigraph.sources.naming import camera_size_px
from haptigraph.sources.oct.oct import OctSource

RNG = np.random.default_rng(5)
SCANS = RNG.integers(0, 256, (4, 48, 64)).astype(np.uint8)
SCALE = ("source.axial_mm_per_px=0.0033", "source.lateral_mm_per_px=0.0078")


def opened(path, *settings):
    config = load_config(None, (f'source.uri="oct:{path}"', *settings))
    return open_source(config, VirtualClock())


def scale_of(path, *settings):
    source = OctSource(str(path), load_config(None, settings).source)
    source.close()
    scale = tomllib.loads(source.registration)["scale"]
    return scale["axial_mm_per_px"], scale["lateral_mm_per_px"]


def error_of(path, *settings):
    with pytest.raises(BadInput) as raised:
        drain(opened(path, *settings))
    message = str(raised.value)
    assert "\n" not in message
    return message


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "scans"
    path.mkdir()
    for number, image in enumerate(SCANS):
        cv2.imwrite(str(path / f"{number}.png"), image)
    return path


# --- folders and images


def test_a_folder_of_b_scans_is_read_unchanged(folder):
    captures = drain(opened(folder, *SCALE, "source.rate_hz=10"))
    assert [capture.stamp_ns for capture in captures] == [0, 100_000_000, 200_000_000, 300_000_000]
    assert np.array_equal([capture.image for capture in captures], SCANS)


def test_a_single_b_scan_is_read(folder):
    (capture,) = drain(opened(folder / "2.png", *SCALE))
    assert np.array_equal(capture.image, SCANS[2])


def test_an_unknown_scale_is_an_error_that_names_the_setting(folder):
    assert "states no axial scale" in error_of(folder)
    assert "--set source.axial_mm_per_px=" in error_of(folder)
    assert "--set source.lateral_mm_per_px=" in error_of(folder, SCALE[0])


def test_a_registration_replaces_the_scale(folder, tmp_path):
    (tmp_path / "scan.toml").write_text("")
    source = opened(folder, f'source.registration="{tmp_path / "scan.toml"}"')
    assert source.registration is None
    assert len(drain(source)) == len(SCANS)


@pytest.mark.parametrize(
    ("axial", "lateral", "problem"),
    [(3.3, 0.0078, "3.3 mm, axial scale; 0.0005 to 0.02"), (0.0033, 7.8, "7.8 mm, lateral scale")],
)
def test_a_scale_in_micrometres_is_rejected(folder, axial, lateral, problem):
    settings = f"source.axial_mm_per_px={axial}", f"source.lateral_mm_per_px={lateral}"
    assert problem in error_of(folder, *settings)


def test_every_image_is_cropped_and_the_crop_must_be_inside(folder):
    captures = drain(opened(folder, *SCALE, "source.crop_px=[8, 4, 32, 40]"))
    assert np.array_equal([capture.image for capture in captures], SCANS[:, 4:44, 8:40])
    assert "asks for 32 x 40 px from (40, 4), but the image is 64 x 48 px" in error_of(
        folder, *SCALE, "source.crop_px=[40, 4, 32, 40]"
    )


def test_other_sources_are_cropped(folder):
    config = load_config(None, (f'source.uri="{folder}"', "source.crop_px=[8, 4, 32, 40]"))
    captures = drain(open_source(config, VirtualClock()))
    assert np.array_equal([capture.image for capture in captures], SCANS[:, 4:44, 8:40])


# --- depth


def deep(tmp_path, bits, dtype=np.uint16):
    path = tmp_path / f"deep.{'tif' if dtype != np.uint16 else 'png'}"
    cv2.imwrite(str(path), (SCANS[0].astype(np.float64) / 255 * (2**bits - 1)).astype(dtype))
    return path


def test_16_bits_are_scaled_to_8(tmp_path):
    (capture,) = drain(opened(deep(tmp_path, 16), *SCALE))
    assert np.abs(capture.image.astype(int) - SCANS[0]).max() <= 1


def test_12_bits_in_16_must_be_configured(tmp_path):
    path = deep(tmp_path, 12)
    assert "none is brighter than 4095 of 65535" in error_of(path, *SCALE)
    assert "--set source.bits=12" in error_of(path, *SCALE)
    (capture,) = drain(opened(path, *SCALE, "source.bits=12"))
    assert np.abs(capture.image.astype(int) - SCANS[0]).max() <= 1


def test_a_contradictory_or_unsupported_depth_is_rejected(tmp_path, folder):
    assert "needs more bits than source.bits=10" in error_of(deep(tmp_path, 12), *SCALE, "source.bits=10")
    assert "has 8 bits per pixel, but source.bits is 12" in error_of(folder, *SCALE, "source.bits=12")
    assert "pixels of type float32" in error_of(deep(tmp_path, 1, np.float32), *SCALE)


def test_a_multi_page_image_is_a_volume(tmp_path):
    cv2.imwritemulti(str(tmp_path / "v.tif"), list(SCANS))
    assert "v.tif: a volume: it contains 4 B-scans; it states no distance" in error_of(
        tmp_path / "v.tif", *SCALE
    )


# --- a monitor's video


def test_a_video_of_a_monitor_is_cropped_to_the_scan(tmp_path):
    path = tmp_path / "monitor.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (160, 120))
    screen = np.full((120, 160, 3), 40, np.uint8)
    screen[20:84, 30:126] = 200
    for _ in range(5):
        writer.write(screen)
    writer.release()
    captures = drain(opened(path, *SCALE, "source.crop_px=[30, 20, 96, 64]"))
    assert [capture.image.shape for capture in captures] == [(64, 96, 3)] * 5
    assert all(capture.image.min() > 150 for capture in captures)
    assert captures[1].stamp_ns == 40_000_000
    assert "states no axial scale" in error_of(path)


# --- DICOM


def dicom_file(tmp_path, images, *, spacing=(0.0039, 0.0115), positions=None, **elements):
    files = pytest.importorskip("dicom_files", reason="needs pydicom", exc_type=ImportError)
    from pydicom.dataset import Dataset

    def spaced():
        group, measures = Dataset(), Dataset()
        measures.PixelSpacing = list(spacing)
        group.PixelMeasuresSequence = [measures]
        return group

    def positioned(position):
        group, location = Dataset(), Dataset()
        location.ReferenceCoordinates = list(position)
        group.OphthalmicFrameLocationSequence = [location]
        return group

    groups = {"SharedFunctionalGroupsSequence": [spaced()]} if spacing else {}
    if positions:
        groups["PerFrameFunctionalGroupsSequence"] = [positioned(position) for position in positions]
    return files.write(tmp_path / "oct.dcm", files.dicom(images, **groups, **elements))


def test_dicom_states_the_row_spacing_first(tmp_path):
    path = dicom_file(tmp_path, SCANS[:1])
    assert scale_of(path) == (0.0039, 0.0115)
    (capture,) = drain(opened(path))
    assert np.array_equal(capture.image, SCANS[0])


def test_a_configured_scale_overrides_the_file_with_a_note(tmp_path):
    path = dicom_file(tmp_path, SCANS[:1])
    source = opened(path, SCALE[1])
    note = "source.lateral_mm_per_px=0.0078 overrides the lateral scale in the file, 0.0115"
    assert note in source.notes[0]
    source.close()
    assert scale_of(path, SCALE[1]) == (0.0039, 0.0078)


def test_dicom_without_a_scale_is_an_error(tmp_path):
    assert "states no axial scale" in error_of(dicom_file(tmp_path, SCANS[:1], spacing=None))


def test_a_volume_needs_the_distance_of_its_b_scans_unless_it_is_played_as_a_sequence(tmp_path):
    path = dicom_file(tmp_path, SCANS, positions=[(row, 10, row, 90) for row in range(4)])
    problem = error_of(path)
    assert "a volume: it contains 4 B-scans of different positions; it states no distance between" in problem
    assert "set it, for example --set source.slice_mm=0.05; --set source.volume_as_sequence=true" in problem
    captures = drain(opened(path, "source.volume_as_sequence=true"))
    assert np.array_equal([capture.image for capture in captures], SCANS)


def test_a_series_at_one_position_is_not_a_volume(tmp_path):
    path = dicom_file(tmp_path, SCANS, positions=[(7, 10, 7, 90)] * 4, FrameTime=50)
    assert [capture.stamp_ns for capture in drain(opened(path))] == [0, 50_000_000, 100_000_000, 150_000_000]


def test_images_without_positions_are_a_volume(tmp_path):
    assert "does not state that they show one position" in error_of(dicom_file(tmp_path, SCANS))


def test_a_photograph_is_rejected(tmp_path):
    path = dicom_file(tmp_path, SCANS[:1], SOPClassUID="1.2.840.10008.5.1.4.1.1.77.1.5.1")
    assert "contains Ophthalmic Photography 8 Bit Image, not OCT" in error_of(path)


def test_32_bits_are_rejected(tmp_path):
    files = pytest.importorskip("dicom_files", reason="needs pydicom", exc_type=ImportError)
    path = files.write(tmp_path / "deep.dcm", files.dicom(SCANS[:1].astype(np.uint32), bits=32))
    assert "has 32 bits per pixel; supported are 8 and 16" in error_of(path, *SCALE)


# --- vendors' files


def heidelberg(path, scans):
    pytest.importorskip("eyepy", reason="needs eyepy", exc_type=ImportError)
    return heidelberg_vol(path, scans)


def test_a_line_scan_of_heidelberg_has_its_scale(tmp_path):
    path = heidelberg(tmp_path / "one.vol", SCANS[:1])
    assert scale_of(path) == (0.0039, 0.0115)
    (capture,) = drain(opened(path))
    assert np.array_equal(capture.image, SCANS[0])


def test_a_vendors_file_is_opened_by_its_path(tmp_path):
    path = heidelberg(tmp_path / "one.vol", SCANS[:1])
    source = open_source(load_config(None, (f'source.uri="{path}"',)), VirtualClock())
    assert len(drain(source)) == 1


def test_a_vendors_volume_is_one_capture_unless_configured_as_a_sequence(tmp_path):
    path = heidelberg(tmp_path / "cube.vol", SCANS)
    (volume,) = drain(opened(path))
    assert np.array_equal(volume.image, np.concatenate(list(SCANS), axis=1))
    captures = drain(opened(path, "source.volume_as_sequence=true"))
    assert np.array_equal([capture.image for capture in captures], SCANS)


def test_a_file_saved_by_eyepy_is_read(tmp_path):
    eyepy = pytest.importorskip("eyepy", reason="needs eyepy", exc_type=ImportError)
    metas = [eyepy.EyeBscanMeta(start_pos=(0, z), end_pos=(6, z), pos_unit="mm") for z in range(len(SCANS))]
    sizes = {"scale_x": 0.0115, "scale_y": 0.0039, "scale_z": 0.12, "scale_unit": "mm"}
    eyepy.EyeVolume(data=SCANS, meta=eyepy.EyeVolumeMeta(**sizes, bscan_meta=metas)).save(tmp_path / "v.eye")
    assert scale_of(tmp_path / "v.eye", "source.volume_as_sequence=true") == (0.0039, 0.0115)


def test_a_truncated_vendors_file_is_rejected(tmp_path):
    pytest.importorskip("eyepy", reason="needs eyepy", exc_type=ImportError)
    (tmp_path / "truncated.vol").write_bytes(b"HSF-OCT-103" + bytes(500))
    assert "truncated.vol: not a file that eyepy can read" in error_of(tmp_path / "truncated.vol")
    assert "no such file" in error_of(tmp_path / "gone.e2e")


@pytest.mark.parametrize(("name", "library"), [("scan.vol", "eyepy"), ("scan.dcm", "pydicom")])
def test_a_missing_extra_is_named(tmp_path, monkeypatch, name, library):
    monkeypatch.setitem(sys.modules, library, None)
    (tmp_path / name).write_bytes(bytes(200))
    with pytest.raises(MissingExtra, match=r"pip install 'haptigraph\[oct\]'"):
        opened(tmp_path / name)


def test_proprietary_formats_are_rejected(tmp_path):
    (tmp_path / "cube.img").write_bytes(bytes(100))
    assert "Zeiss's raw volume (.img) cannot be read; export DICOM" in error_of(tmp_path / "cube.img", *SCALE)
    assert "no such file or folder" in error_of(tmp_path / "nothing", *SCALE)


def test_topcons_format_needs_a_separate_library(tmp_path, monkeypatch):
    pytest.importorskip("eyepy", reason="needs eyepy", exc_type=ImportError)
    monkeypatch.setitem(sys.modules, "oct_converter", None)
    monkeypatch.setitem(sys.modules, "oct_converter.readers", None)
    (tmp_path / "x.fda").write_bytes(bytes(300))
    assert "Topcon's format needs oct-converter" in error_of(tmp_path / "x.fda")


def test_a_camera_whose_images_are_cropped_needs_a_configured_size():
    crop = "source.crop_px=[0, 0, 640, 480]"
    whole = load_config(None, (crop, "source.width_px=1920", "source.height_px=1080")).source
    assert camera_size_px(whole, (640, 480)) == (1920, 1080)
    with pytest.raises(BadInput, match=r"set the size of the whole image with source\.width_px"):
        camera_size_px(load_config(None, (crop,)).source, (640, 480))
