import sys

import cv2
import numpy as np
import pytest
from dicom_files import dicom, write
from helpers import drain
from hypothesis import given, settings
from hypothesis import strategies as st
from pydicom.dataset import Dataset
from pydicom.encaps import encapsulate
from pydicom.uid import (
    MPEG4HP41,
    JPEG2000Lossless,
    JPEGBaseline8Bit,
    JPEGLSLossless,
    RLELossless,
    TwelveLeadECGWaveformStorage,
)

from haptigraph.assemble import open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import load_config
from haptigraph.errors import BadInput, MissingExtra
from haptigraph.sources.oct.dicom import DicomSource

RNG = np.random.default_rng(3)
GREY = RNG.integers(0, 256, (5, 12, 16)).astype(np.uint8)
COLOUR = RNG.integers(0, 256, (3, 12, 16, 3)).astype(np.uint8)
SMOOTH = cv2.GaussianBlur(cv2.resize(COLOUR[0], (64, 48)), (0, 0), 5)


def images_of(path):
    return [capture.image for capture in drain(DicomSource(path, 30.0))]


def first_of(tmp_path, data):
    return images_of(write(tmp_path / "x.dcm", data))[0]


def test_images_come_in_order_and_unchanged(tmp_path):
    path = write(tmp_path / "oct.dcm", dicom(GREY))
    captures = drain(DicomSource(path, 25.0))
    assert [capture.index for capture in captures] == list(range(5))
    assert np.array_equal([capture.image for capture in captures], GREY)
    source = DicomSource(path, 25.0)
    source.read(1.0)
    source.close()
    source.close()


def test_a_single_image_is_read(tmp_path):
    (image,) = images_of(write(tmp_path / "photo.dcm", dicom(COLOUR[:1], "RGB")))
    assert np.array_equal(image, COLOUR[0][..., ::-1])


# --- display


def test_monochrome1_is_inverted(tmp_path):
    assert np.array_equal(first_of(tmp_path, dicom(GREY, "MONOCHROME1")), 255 - GREY[0])


def test_ybr_is_converted_to_bgr(tmp_path):
    ycrcb = cv2.cvtColor(SMOOTH, cv2.COLOR_BGR2YCrCb)
    image = first_of(tmp_path, dicom(ycrcb[None, ..., [0, 2, 1]], "YBR_FULL"))
    assert np.abs(image.astype(int) - SMOOTH).max() <= 3


def test_a_palette_is_applied(tmp_path):
    levels = np.arange(256, dtype=np.uint16) << 8
    descriptor = [256, 0, 16]
    palette = {
        "RedPaletteColorLookupTableDescriptor": descriptor,
        "GreenPaletteColorLookupTableDescriptor": descriptor,
        "BluePaletteColorLookupTableDescriptor": descriptor,
        "RedPaletteColorLookupTableData": levels.tobytes(),
        "GreenPaletteColorLookupTableData": levels[::-1].tobytes(),
        "BluePaletteColorLookupTableData": np.zeros(256, np.uint16).tobytes(),
    }
    image = first_of(tmp_path, dicom(GREY, "PALETTE COLOR", **palette))
    assert np.array_equal(image[..., 2], GREY[0])
    assert np.array_equal(image[..., 1], 255 - GREY[0])
    assert not image[..., 0].any()


@pytest.mark.parametrize(
    ("dtype", "bits"), [(np.uint16, 16), (np.uint16, 12), (np.int16, 16), (np.int16, 12)]
)
def test_deep_images_are_scaled_to_8_bits_by_their_possible_range(tmp_path, dtype, bits):
    low = -(2 ** (bits - 1)) if dtype is np.int16 else 0
    stored = (np.linspace(0, 2**bits - 1, 60).reshape(1, 6, 10) + low).astype(dtype)
    image = first_of(tmp_path, dicom(stored, bits=bits))
    assert image[0, 0] == 0
    assert image[-1, -1] == 255
    assert np.abs(image.ravel() - np.linspace(0, 255, 60)).max() <= 0.6


def test_a_window_and_a_rescale_are_applied(tmp_path):
    stored = np.arange(0, 4096, 64, dtype=np.uint16).reshape(1, 8, 8)
    elements = {"RescaleSlope": 2, "RescaleIntercept": -1000, "WindowCenter": 1000, "WindowWidth": 2001}
    image = first_of(tmp_path, dicom(stored, bits=12, **elements))
    shown = np.clip((2.0 * stored[0] - 1000) / 2000, 0, 1) * 255  # 0 to 2000 after rescaling
    assert np.abs(image - shown).max() <= 1


def test_a_window_of_an_enhanced_file_is_applied(tmp_path):
    window, groups = Dataset(), Dataset()
    window.WindowCenter, window.WindowWidth = 128, 65
    groups.FrameVOILUTSequence = [window]
    image = first_of(tmp_path, dicom(GREY, SharedFunctionalGroupsSequence=[groups]))
    assert set(np.unique(image[(GREY[0] < 90) | (GREY[0] > 165)])) == {0, 255}


@pytest.mark.parametrize(("syntax", "kind"), [(JPEGBaseline8Bit, ".jpg"), (JPEG2000Lossless, ".jp2")])
def test_compressed_images_are_decoded(tmp_path, syntax, kind):
    data = dicom(SMOOTH[None, ..., ::-1], "YBR_FULL_422" if kind == ".jpg" else "YBR_RCT")
    coded = cv2.imencode(
        kind, SMOOTH, [cv2.IMWRITE_JPEG2000_COMPRESSION_X1000, 1000] if kind == ".jp2" else []
    )[1]
    data.PixelData = encapsulate([coded.tobytes()])
    data["PixelData"].VR = "OB"
    data.file_meta.TransferSyntaxUID = syntax
    image = first_of(tmp_path, data)
    assert np.abs(image.astype(int) - SMOOTH).mean() < 3


def test_run_length_encoding_is_decoded_losslessly(tmp_path):
    data = dicom(GREY)
    data.compress(RLELossless)
    assert np.array_equal(images_of(write(tmp_path / "r.dcm", data)), GREY)


# --- time


@pytest.mark.parametrize(
    ("elements", "stamps_ms", "rate_hz"),
    [
        ({"FrameTime": 40}, [0, 40, 80, 120, 160], 25.0),
        ({"FrameTimeVector": [0, 33, 34, 33, 100]}, [0, 33, 67, 100, 200], 1e3 / 33.5),
        ({"CineRate": 20}, [0, 50, 100, 150, 200], 20.0),
        ({"RecommendedDisplayFrameRate": 5}, [0, 200, 400, 600, 800], 5.0),
        ({"FrameTime": 0}, [0, 100, 200, 300, 400], 10.0),
        ({"FrameTimeVector": [0, 33]}, [0, 100, 200, 300, 400], 10.0),
        ({}, [0, 100, 200, 300, 400], 10.0),
    ],
)
def test_images_are_stamped_by_the_file_or_at_the_configured_rate(tmp_path, elements, stamps_ms, rate_hz):
    source = DicomSource(write(tmp_path / "t.dcm", dicom(GREY, **elements)), 10.0)
    assert source.rate_hz == pytest.approx(rate_hz)
    assert [capture.stamp_ns / 1e6 for capture in drain(source)] == stamps_ms


def groups_of(times):
    groups = []
    for time in times:
        group, content = Dataset(), Dataset()
        if time:
            content.FrameAcquisitionDateTime = time
        group.FrameContentSequence = [content]
        groups.append(group)
    return groups


@pytest.mark.parametrize(
    ("times", "stamps_ms"),
    [
        (["20260301120059.900000", "20260301120100.033333", "20260301120100.2"], [0, 133.333, 300]),
        (["20260301120059.9+0100", "20260301120100+0100", "20260301120101+0100"], [0, 100, 1100]),
        (["20260301120059.9", "20260301120059.9", "20260301120059.9"], [0, 40, 80]),  # a volume
        (["20260301120059.9", "", "20260301120100"], [0, 40, 80]),
    ],
)
def test_enhanced_files_state_the_acquisition_time_of_each_image(tmp_path, times, stamps_ms):
    data = dicom(GREY[:3], PerFrameFunctionalGroupsSequence=groups_of(times))
    captures = drain(DicomSource(write(tmp_path / "e.dcm", data), 25.0))
    assert [capture.stamp_ns / 1e6 for capture in captures] == stamps_ms


# --- errors


def error_of(path):
    with pytest.raises(BadInput) as raised:
        images_of(path)
    message = str(raised.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    return message


@pytest.mark.parametrize("count", [99, 2**31 - 1, -1])
def test_more_images_than_the_file_can_hold_are_refused(tmp_path, count):
    data = dicom(GREY)
    data.NumberOfFrames = count
    with pytest.raises(BadInput, match=rf"x\.dcm: states {count} images; its \d+ bytes cannot hold as many"):
        DicomSource(write(tmp_path / "x.dcm", data), 30.0)


def test_a_file_that_is_not_dicom_is_rejected(tmp_path):
    assert "cannot be read (No such file or directory)" in error_of(tmp_path / "gone.dcm")
    (tmp_path / "text.dcm").write_text("hello" * 100)
    assert "not a valid DICOM file" in error_of(tmp_path / "text.dcm")
    (tmp_path / "truncated.dcm").write_bytes(write(tmp_path / "w.dcm", dicom(GREY)).read_bytes()[:250])
    assert "truncated.dcm" in error_of(tmp_path / "truncated.dcm")


@given(st.lists(st.tuples(st.integers(132, 900), st.integers(0, 255)), min_size=1, max_size=4))
@settings(max_examples=200)
@pytest.mark.filterwarnings("ignore")  # pydicom warns about oddities
def test_a_damaged_file_is_read_or_rejected_in_one_sentence(tmp_path_factory, damage):
    folder = tmp_path_factory.mktemp("damaged")
    path = write(folder / "d.dcm", dicom(GREY[:2], FrameTimeVector=[0, 33], WindowCenter=99, WindowWidth=50))
    data = bytearray(path.read_bytes())
    for offset, value in damage:
        data[offset % len(data)] = value
    path.write_bytes(data)
    try:
        images = images_of(path)
    except BadInput as error:
        assert str(error).startswith(str(path))
        assert "\n" not in str(error)
    else:
        assert all(image.dtype == np.uint8 for image in images)


def test_a_file_without_images_is_rejected(tmp_path):
    data = dicom(GREY)
    del data.PixelData, data.Rows
    data.SOPClassUID = TwelveLeadECGWaveformStorage
    assert "contains no images (12-lead ECG Waveform Storage)" in error_of(write(tmp_path / "e.dcm", data))


def test_a_truncated_file_is_reported(tmp_path):
    path = write(tmp_path / "short.dcm", dicom(GREY))
    path.write_bytes(path.read_bytes()[:-300])
    assert "image 3: cannot be decoded" in error_of(path)


def test_unknown_colours_are_rejected(tmp_path):
    assert "has photometric interpretation 'CMYK'; supported are MONOCHROME1," in error_of(
        write(tmp_path / "c.dcm", dicom(GREY, "CMYK"))
    )


@pytest.mark.parametrize(
    ("syntax", "problem"),
    [
        (
            JPEGLSLossless,
            "is compressed as JPEG-LS Lossless Image Compression, and no decoder is installed; pip install one of: ",
        ),
        (
            MPEG4HP41,
            "is compressed as MPEG-4 AVC/H.264 High Profile / Level 4.1; extract the video and use that",
        ),
    ],
)
def test_compression_without_a_decoder_is_rejected(tmp_path, syntax, problem):
    data = dicom(GREY)
    data.PixelData = encapsulate([image.tobytes() for image in GREY])
    data["PixelData"].VR = "OB"
    data.file_meta.TransferSyntaxUID = syntax
    assert problem in error_of(write(tmp_path / "c.dcm", data))


def test_a_missing_extra_is_named(tmp_path, monkeypatch):
    path = write(tmp_path / "oct.dcm", dicom(GREY))
    monkeypatch.setitem(sys.modules, "pydicom", None)
    with pytest.raises(MissingExtra, match=r"pip install 'haptigraph\[dicom\]'"):
        DicomSource(path, 30.0)


# --- by its path


@pytest.mark.parametrize("name", ["oct.dcm", "IM_0001", "oct.DCM"])
def test_a_file_is_opened_by_its_path_with_or_without_suffix(tmp_path, name):
    path = write(tmp_path / name, dicom(GREY, FrameTime=40))
    source = open_source(load_config(None, (f'source.uri="{path}"',)), VirtualClock())
    assert source.rate_hz == 25.0
    assert np.array_equal(source.read(1.0).image, GREY[0])
    source.close()
