"""Images from a DICOM file, single or many, grey or colour, by the file's own time.

Turns stored values into what a viewer would show: rescaled, windowed, palettes looked up, 8 bit. The time of
each image is the acquisition's, as far as the file tells it; a volume is played as if it were a film. Knows
nothing of patients: of all that a DICOM file says, only pixels, their meaning and their time are read.
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

__all__ = ["DicomSource"]

VIDEO = ("MPEG", "HEVC", "SMPTE")  # transfer syntaxes that are films in a DICOM envelope
VALUES = ("RescaleSlope", "RescaleIntercept", "WindowCenter", "WindowWidth", "VOILUTFunction")
KINDS = (
    "MONOCHROME1",
    "MONOCHROME2",
    "PALETTE COLOR",
    "RGB",
    "YBR_FULL",
    "YBR_FULL_422",
    "YBR_ICT",
    "YBR_RCT",
)
NEEDED = ("Rows", "Columns", "BitsStored", "PixelRepresentation", "PhotometricInterpretation")
GROUPS = ("PixelValueTransformationSequence", "FrameVOILUTSequence")


class DicomSource:
    """Read a DICOM file with pydicom.

    Args:
        path: The file.
        rate_hz: Images per second where the file tells no time.

    Raises:
        MissingExtra: If pydicom is not installed.
        BadInput: If it is no DICOM file, has no images, or no decoder for them is installed.
    """

    is_live = False
    registration: str | None = None

    def __init__(self, path: str | Path, rate_hz: float) -> None:
        self._path = Path(path)
        try:
            self._dicom = import_module("pydicom")
        except ModuleNotFoundError:
            raise MissingExtra(f"{path}: DICOM", "dicom") from None
        try:
            header = self._dicom.dcmread(self._path, stop_before_pixels=True)
            self._check(header)
            self._stamps_ns = _stamps_ns(header, int(header.get("NumberOfFrames") or 1), rate_hz)
            self._display = _Display(header)
        except BadInput:
            raise
        except OSError as error:
            raise self._bad(f"cannot be read ({error.strerror})") from None
        except Exception as error:  # pydicom raises whatever a torn file makes of it
            raise self._bad(f"not a DICOM file that makes sense ({error})") from None
        between_ns = np.diff(self._stamps_ns)
        self.rate_hz = 1e9 / float(np.median(between_ns)) if len(between_ns) else rate_hz
        self._images: Generator[NDArray[Any], None, None] = self._dicom.pixels.iter_pixels(self._path)
        self._index = -1

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next image."""
        if self._index + 1 >= len(self._stamps_ns):
            raise EndOfSource
        self._index += 1
        try:
            image = self._display(next(self._images))
        except Exception as error:  # decoders are many, and so are their errors
            told = str(error) or type(error).__name__
            raise self._bad(f"cannot be decoded ({told})", f"image {self._index}") from None
        return Capture(self._index, self._stamps_ns[self._index], image)

    def close(self) -> None:
        """Close the file."""
        self._images.close()

    def _check(self, header: Any) -> None:
        """Refuse what has no images, and images that nothing installed can show."""
        if any(key not in header for key in NEEDED) or "TransferSyntaxUID" not in header.file_meta:
            what = getattr(header.get("SOPClassUID"), "name", "it says not what it is")
            raise self._bad(f"holds no images ({what})")
        if header.PhotometricInterpretation not in KINDS:
            kind = f"colours of kind {header.PhotometricInterpretation!r}"
            raise self._bad(f"has {kind}; {', '.join(KINDS)} are read")
        syntax = header.file_meta.TransferSyntaxUID
        try:
            decoder = self._dicom.pixels.get_decoder(syntax)
        except NotImplementedError:
            film = any(word in syntax.name for word in VIDEO)
            advice = "take the film out, and give that" if film else "convert it, for example with dcmdjpeg"
            raise self._bad(f"is compressed as {syntax.name}; {advice}") from None
        if not decoder.is_available:
            needs = " or ".join(entry.partition(" ")[0] for entry in decoder.missing_dependencies)
            advice = f"no decoder is installed; pip install one of: {needs}"
            raise self._bad(f"is compressed as {syntax.name}, and {advice}")

    def _bad(self, problem: str, place: str = "") -> BadInput:
        return BadInput(" ".join(problem.split()), self._path, place)  # a torn file may hold line breaks


class _Display:
    """From stored values to what is shown.

    Args:
        header: The data set without its pixels.
    """

    def __init__(self, header: Any) -> None:
        self._pixels = import_module("pydicom.pixels")
        self._header = _with_shared_values(header)
        self._kind = str(header.PhotometricInterpretation)
        self._bits = int(header.BitsStored)

    def __call__(self, stored: NDArray[Any]) -> Image:
        """Return one image, (h, w) grey or (h, w, 3) BGR; YBR was made RGB by the decoder."""
        if self._kind == "PALETTE COLOR":
            colour = self._pixels.apply_color_lut(stored, self._header)
            bits = int(self._header.RedPaletteColorLookupTableDescriptor[2])
            return _bgr(colour, bits)
        if stored.ndim == 3:
            return _bgr(stored, self._bits)
        grey = self._grey(stored)
        return 255 - grey if self._kind == "MONOCHROME1" else grey

    def _grey(self, stored: NDArray[Any]) -> Image:
        """Rescale, window, and spread the possible values over 8 bit, the same for every image."""
        header = self._header
        low, high = (
            (0, 2**self._bits - 1)
            if not header.PixelRepresentation
            else (
                -(2 ** (self._bits - 1)),
                2 ** (self._bits - 1) - 1,
            )
        )
        ends = self._pixels.apply_modality_lut(np.array([low, high], stored.dtype), header)
        shown = self._pixels.apply_voi_lut(self._pixels.apply_modality_lut(stored, header), header)
        first, last = sorted(float(end) for end in ends)
        if "VOILUTSequence" in header:
            first, last = 0.0, 2.0 ** int(header.VOILUTSequence[0].LUTDescriptor[2]) - 1
        share = (np.asarray(shown, np.float64) - first) / (last - first)
        return np.asarray(np.rint(255 * np.clip(share, 0, 1)), np.uint8)


def _bgr(rgb: NDArray[Any], bits: int) -> Image:
    eight = rgb >> (bits - 8) if bits > 8 else rgb
    return np.ascontiguousarray(eight[..., ::-1].astype(np.uint8))


def _with_shared_values(header: Any) -> Any:
    """Copy what enhanced files say of all images, or of the first, to where plain files have it."""
    for groups in ("SharedFunctionalGroupsSequence", "PerFrameFunctionalGroupsSequence"):
        for group in header.get(groups, [])[:1]:
            for item in (found for name in GROUPS for found in group.get(name, [])[:1]):
                for key in VALUES:
                    if key in item and key not in header:
                        setattr(header, key, item[key].value)
    return header


def _stamps_ns(header: Any, count: int, rate_hz: float) -> Sequence[int]:
    """Return when each image was taken [ns], from 0, by the best that the file says of it."""
    steps_ms = [float(step) for step in _several(header.get("FrameTimeVector"))]
    if len(steps_ms) == count and min(steps_ms[1:], default=1.0) > 0:
        return [round(1e6 * passed) for passed in np.cumsum([0.0, *steps_ms[1:]])]
    acquired = _acquired_ns(header)
    if len(acquired) == count and (np.diff(acquired) > 0).all():
        return [stamp - acquired[0] for stamp in acquired]
    period_ms = float(header.get("FrameTime") or 0)
    rates = (header.get("CineRate"), header.get("RecommendedDisplayFrameRate"), rate_hz)
    told_hz = next(float(rate) for rate in rates if rate and float(rate) > 0)
    period_ns = 1e6 * period_ms if period_ms > 0 else 1e9 / told_hz
    return [round(number * period_ns) for number in range(count)]


def _acquired_ns(header: Any) -> list[int]:
    """Return the acquisition time of each image of an enhanced file [ns]; empty if not all have one."""
    valuerep = import_module("pydicom.valuerep")
    stamps = []
    for group in header.get("PerFrameFunctionalGroupsSequence", []):
        content = group.get("FrameContentSequence", [None])[0]
        moment = valuerep.DT(content.get("FrameAcquisitionDateTime") or "") if content else None
        if not moment:
            return []
        whole = int(moment.replace(microsecond=0, tzinfo=moment.tzinfo or datetime.UTC).timestamp())
        stamps.append(whole * 1_000_000_000 + moment.microsecond * 1000)
    return stamps


def _several(value: Any) -> Sequence[Any]:
    """Return the values of an element that may have none, one or several."""
    if value is None:
        return []
    return list(value) if hasattr(value, "__len__") and not isinstance(value, str) else [value]
