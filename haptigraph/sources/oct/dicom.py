"""Images from a DICOM file, single- or multi-frame, grey or colour, with the file's time stamps.

Converts stored values to what a viewer displays: rescaled, windowed, palettes applied, 8 bits. Images are
stamped by their acquisition time, if the file states it; a volume is played like a film. Only pixels, their
interpretation and their times are read, no patient data.
"""

import datetime
from collections.abc import Generator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptigraph.errors import BadInput, EndOfSource, MissingExtra
from haptigraph.messages import Capture, Image
from haptigraph.stages import Source

__all__ = ["DicomSource"]

VIDEO = ("MPEG", "HEVC", "SMPTE")  # transfer syntaxes that encapsulate a video
VALUE_KEYS = ("RescaleSlope", "RescaleIntercept", "WindowCenter", "WindowWidth", "VOILUTFunction")
PHOTOMETRIC = (
    "MONOCHROME1",
    "MONOCHROME2",
    "PALETTE COLOR",
    "RGB",
    "YBR_FULL",
    "YBR_FULL_422",
    "YBR_ICT",
    "YBR_RCT",
)
REQUIRED = ("Rows", "Columns", "BitsStored", "PixelRepresentation", "PhotometricInterpretation")
MIN_IMAGE_BYTES = 8  # of a compressed one: its item's header
VALUE_SEQUENCES = ("PixelValueTransformationSequence", "FrameVOILUTSequence")


class DicomSource(Source):
    """Read a DICOM file with pydicom.

    Args:
        path: The file.
        rate_hz: Images per second if the file states no times.

    Raises:
        MissingExtra: If pydicom is not installed.
        BadInput: If the file is not DICOM, has no images, or no decoder for them is installed.
    """

    is_live = False

    def __init__(self, path: str | Path, rate_hz: float) -> None:
        self._path = Path(path)
        try:
            self._dicom = import_module("pydicom")
        except ModuleNotFoundError:
            raise MissingExtra(f"{path}: DICOM", "dicom") from None
        try:
            header = self._dicom.dcmread(self._path, stop_before_pixels=True)
            self._check(header)
            self._stamps_ns = _stamps_ns(header, self._count(header), rate_hz)
            self._display = _Display(header)
        except BadInput:
            raise
        except OSError as error:
            raise self._error(f"cannot be read ({error.strerror})") from None
        except Exception as error:  # pydicom raises anything for a damaged file
            raise self._error(f"not a valid DICOM file ({error})") from None
        intervals_ns = np.diff(self._stamps_ns)
        self.rate_hz = 1e9 / float(np.median(intervals_ns)) if len(intervals_ns) else rate_hz
        self._images: Generator[NDArray[Any], None, None] = self._dicom.pixels.iter_pixels(self._path)
        self._index = -1

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next image."""
        if self._index + 1 >= len(self._stamps_ns):
            raise EndOfSource
        self._index += 1
        try:
            image = self._display(next(self._images))
        except Exception as error:  # of whichever decoder
            reason = str(error) or type(error).__name__
            raise self._error(f"cannot be decoded ({reason})", f"image {self._index}") from None
        return Capture(self._index, self._stamps_ns[self._index], image)

    def close(self) -> None:
        """Close the file."""
        self._images.close()

    def _check(self, header: Any) -> None:
        """Reject files without images, and images that no installed decoder reads."""
        if any(key not in header for key in REQUIRED) or "TransferSyntaxUID" not in header.file_meta:
            kind = getattr(header.get("SOPClassUID"), "name", "of unknown type")
            raise self._error(f"contains no images ({kind})")
        if header.PhotometricInterpretation not in PHOTOMETRIC:
            kind = f"photometric interpretation {header.PhotometricInterpretation!r}"
            raise self._error(f"has {kind}; supported are {', '.join(PHOTOMETRIC)}")
        syntax = header.file_meta.TransferSyntaxUID
        try:
            decoder = self._dicom.pixels.get_decoder(syntax)
        except NotImplementedError:
            is_video = any(word in syntax.name for word in VIDEO)
            advice = "extract the video and use that" if is_video else "convert it, for example with dcmdjpeg"
            raise self._error(f"is compressed as {syntax.name}; {advice}") from None
        if not decoder.is_available:
            needs = " or ".join(entry.partition(" ")[0] for entry in decoder.missing_dependencies)
            advice = f"no decoder is installed; pip install one of: {needs}"
            raise self._error(f"is compressed as {syntax.name}, and {advice}")

    def _count(self, header: Any) -> int:
        """Return the number of images, if the file is large enough for so many."""
        count, size = int(header.get("NumberOfFrames") or 1), self._path.stat().st_size
        bits = header.Rows * header.Columns * int(header.get("SamplesPerPixel") or 1)
        bits *= int(header.get("BitsAllocated") or 8)
        is_compressed = header.file_meta.TransferSyntaxUID.is_compressed
        if count < 1 or count * (MIN_IMAGE_BYTES if is_compressed else bits // 8) > size:
            raise self._error(f"states {count} images; its {size} bytes cannot hold as many")
        return count

    def _error(self, problem: str, place: str = "") -> BadInput:
        return BadInput(" ".join(problem.split()), self._path, place)  # damaged files may add line breaks


class _Display:
    """Conversion of stored values to displayed ones.

    Args:
        header: The data set without its pixels.
    """

    def __init__(self, header: Any) -> None:
        self._pixels = import_module("pydicom.pixels")
        self._header = _with_shared_values(header)
        self._kind = str(header.PhotometricInterpretation)
        self._bits = int(header.BitsStored)

    def __call__(self, stored: NDArray[Any]) -> Image:
        """Return one image, (h, w) grey or (h, w, 3) BGR; the decoder has converted YBR to RGB."""
        if self._kind == "PALETTE COLOR":
            colour = self._pixels.apply_color_lut(stored, self._header)
            bits = int(self._header.RedPaletteColorLookupTableDescriptor[2])
            return _bgr(colour, bits)
        if stored.ndim == 3:
            return _bgr(stored, self._bits)
        grey = self._grey(stored)
        return 255 - grey if self._kind == "MONOCHROME1" else grey

    def _grey(self, stored: NDArray[Any]) -> Image:
        """Rescale, window, and map the range of possible values to 8 bits, the same for every image."""
        header = self._header
        low = -(2 ** (self._bits - 1)) if header.PixelRepresentation else 0
        high = low + 2**self._bits - 1
        ends = self._pixels.apply_modality_lut(np.array([low, high], stored.dtype), header)
        displayed = self._pixels.apply_voi_lut(self._pixels.apply_modality_lut(stored, header), header)
        first, last = sorted(float(end) for end in ends)
        if "VOILUTSequence" in header:
            first, last = 0.0, 2.0 ** int(header.VOILUTSequence[0].LUTDescriptor[2]) - 1
        share = (np.asarray(displayed, np.float64) - first) / (last - first)
        return np.asarray(np.rint(255 * np.clip(share, 0, 1)), np.uint8)


def _bgr(rgb: NDArray[Any], bits: int) -> Image:
    eight = rgb >> (bits - 8) if bits > 8 else rgb
    return np.ascontiguousarray(eight[..., ::-1].astype(np.uint8))


def _with_shared_values(header: Any) -> Any:
    """Copy the values that enhanced files state for all images, or the first, to the top level."""
    for groups in ("SharedFunctionalGroupsSequence", "PerFrameFunctionalGroupsSequence"):
        for group in header.get(groups, [])[:1]:
            for item in (found for name in VALUE_SEQUENCES for found in group.get(name, [])[:1]):
                for key in VALUE_KEYS:
                    if key in item and key not in header:
                        setattr(header, key, item[key].value)
    return header


def _stamps_ns(header: Any, count: int, rate_hz: float) -> Sequence[int]:
    """Return when each image was taken [ns], from 0, from the best information in the file."""
    steps_ms = [float(step) for step in _values(header.get("FrameTimeVector"))]
    if len(steps_ms) == count and min(steps_ms[1:], default=1.0) > 0:
        return [round(1e6 * passed) for passed in np.cumsum([0.0, *steps_ms[1:]])]
    acquired = _acquired_ns(header)
    if len(acquired) == count and (np.diff(acquired) > 0).all():
        return [stamp - acquired[0] for stamp in acquired]
    period_ms = float(header.get("FrameTime") or 0)
    rates = (header.get("CineRate"), header.get("RecommendedDisplayFrameRate"), rate_hz)
    stated_hz = next(float(rate) for rate in rates if rate and float(rate) > 0)
    period_ns = 1e6 * period_ms if period_ms > 0 else 1e9 / stated_hz
    return [round(number * period_ns) for number in range(count)]


def _acquired_ns(header: Any) -> list[int]:
    """Return the acquisition time of each image of an enhanced file [ns]; empty if not all have one."""
    valuerep = import_module("pydicom.valuerep")
    stamps = []
    for group in header.get("PerFrameFunctionalGroupsSequence", []):
        content = group.get("FrameContentSequence", [None])[0]
        acquired = valuerep.DT(content.get("FrameAcquisitionDateTime") or "") if content else None
        if not acquired:
            return []
        seconds = int(acquired.replace(microsecond=0, tzinfo=acquired.tzinfo or datetime.UTC).timestamp())
        stamps.append(seconds * 1_000_000_000 + acquired.microsecond * 1000)
    return stamps


def _values(value: Any) -> Sequence[Any]:
    """Return the values of an element that may have none, one or several."""
    if value is None:
        return []
    return list(value) if hasattr(value, "__len__") and not isinstance(value, str) else [value]
