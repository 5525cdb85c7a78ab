"""Read from OCT files the scale of the B-scans, and whether they are a time series or a volume.

Reads headers of DICOM files (pydicom) and whole files of Heidelberg and Topcon (eyepy), no patient data. A
scale that a file does not state is not guessed.
"""

import logging
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct

from haptigraph.errors import BadInput, EndOfSource, MissingExtra
from haptigraph.messages import Capture
from haptigraph.stages import Source

__all__ = ["EYEPY_FILES", "EyepySource", "ScanFacts", "dicom_facts"]

EYEPY_FILES = {
    ".vol": "import_heyex_vol",
    ".e2e": "import_heyex_e2e",
    ".xml": "import_heyex_xml",
    ".fda": "import_topcon_fda",
    ".eye": "EyeVolume",
}
"""eyepy's readers, by suffix."""
NOT_OCT = "Ophthalmic Photography", "Computed Tomography", "CT Image", "MR Image", "Ultrasound"


class ScanFacts(Struct, frozen=True):
    """What a file states about its B-scans."""

    axial_mm_per_px: float | None = None
    """Pixel height; None: not stated."""
    lateral_mm_per_px: float | None = None
    """Pixel width; None: not stated."""
    slice_mm: float | None = None
    """From one B-scan to the next; None: not stated, or not a volume."""
    volume_reason: str = ""
    """Why its images are a volume; empty: they are a time series, or a single image."""


def dicom_facts(path: Path) -> ScanFacts:
    """Read the facts from the header of a DICOM file.

    Raises:
        MissingExtra: If pydicom is not installed.
        BadInput: If the file cannot be read, or its images are not OCT.
    """
    try:
        pydicom = import_module("pydicom")
    except ModuleNotFoundError:
        raise MissingExtra(f"{path}: OCT in DICOM", "oct") from None
    try:
        header = pydicom.dcmread(path, stop_before_pixels=True)
        kind = str(getattr(header.get("SOPClassUID"), "name", ""))
        if any(word in kind for word in NOT_OCT):
            raise BadInput(f"contains {kind.removesuffix(' Storage')}, not OCT", path)
        if int(header.get("BitsAllocated") or 8) not in (8, 16):
            raise BadInput(f"has {header.BitsAllocated} bits per pixel; supported are 8 and 16", path)
        axial_mm, lateral_mm = _spacing_mm(header)
        return ScanFacts(axial_mm, lateral_mm, _slice_mm(header), _volume_reason(header))
    except BadInput:
        raise
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", path) from None
    except Exception as error:  # pydicom raises anything for a damaged file
        reason = " ".join(str(error).split())
        raise BadInput(f"not a valid DICOM file ({reason})", path) from None


def _spacing_mm(header: Any) -> tuple[float | None, float | None]:
    """Return axial and lateral pixel spacing: PixelSpacing states that of the rows first."""
    for item in (header, *_items(header, "PixelMeasuresSequence")):
        spacing = item.get("PixelSpacing")
        if spacing is not None and len(spacing) == 2:
            return float(spacing[0]), float(spacing[1])
    return None, None


def _slice_mm(header: Any) -> float | None:
    """Return the distance between neighbouring B-scans, from their positions or as stated; None: unknown."""
    places = [
        [float(value) for value in item.get("ImagePositionPatient") or ()]
        for item in _items(header, "PlanePositionSequence")
    ]
    if len(places) > 1 and all(len(place) == 3 for place in places):
        apart_mm = np.linalg.norm(np.diff(np.array(places), axis=0), axis=1)
        if (typical := float(np.median(apart_mm))) > 0:
            return typical
    for item in (header, *_items(header, "PixelMeasuresSequence")):
        if item.get("SpacingBetweenSlices"):
            return abs(float(item.get("SpacingBetweenSlices")))
    return None


def _volume_reason(header: Any) -> str:
    count = int(header.get("NumberOfFrames") or 1)
    if count == 1:
        return ""
    positions = [
        tuple(float(value) for value in item.get(key))
        for name, key in (
            ("OphthalmicFrameLocationSequence", "ReferenceCoordinates"),
            ("PlanePositionSequence", "ImagePositionPatient"),
        )
        for item in _items(header, name)
        if item.get(key)
    ]
    if len(set(positions)) > 1:
        return f"it contains {count} B-scans of different positions"
    is_film = any(key in header for key in ("FrameTime", "FrameTimeVector", "CineRate"))
    if positions or is_film:
        return ""
    return f"it contains {count} B-scans and does not state that they show one position"


def _items(header: Any, name: str) -> Iterator[Any]:
    """Yield the items of a sequence, both those shared by all images and those of single images."""
    for groups in ("SharedFunctionalGroupsSequence", "PerFrameFunctionalGroupsSequence"):
        for group in header.get(groups) or ():
            yield from group.get(name) or ()


class EyepySource(Source):
    """Read a vendor's OCT file with eyepy; the B-scans come in the order of the file.

    Args:
        path: The file.
        rate_hz: Images per second: these files state no times.

    Raises:
        MissingExtra: If eyepy is not installed.
        BadInput: If eyepy cannot read the file.
    """

    is_live = False

    def __init__(self, path: Path, rate_hz: float) -> None:
        self.rate_hz = rate_hz
        self._index = -1
        volume = _read(path)
        try:
            count, height, width = volume.shape
            self._images = np.asarray(volume.data)
            in_mm = volume.scale_unit == "mm"
            scales = (volume.scale_y, volume.scale_x, volume.scale_z if count > 1 else None)
            axial_mm, lateral_mm, slice_mm = (float(scale) if in_mm and scale else None for scale in scales)
        except Exception as error:  # eyepy computes lazily, so damaged files fail here
            raise _unreadable(path, error) from None
        if self._images.dtype != np.uint8 or self._images.shape != (count, height, width):
            raise BadInput(f"eyepy reads it as {self._images.dtype}; expected B-scans of 8 bits", path)
        reason = f"it contains {count} B-scans of different positions" if count > 1 else ""
        self.facts = ScanFacts(axial_mm, lateral_mm, slice_mm, reason)

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next B-scan."""
        self._index += 1
        if self._index >= len(self._images):
            raise EndOfSource
        stamp_ns = round(self._index * 1e9 / self.rate_hz)
        return Capture(self._index, stamp_ns, np.ascontiguousarray(self._images[self._index]))

    def close(self) -> None:
        """Do nothing: the file is already closed."""


def _read(path: Path) -> Any:
    try:
        eyepy = import_module("eyepy")
    except ModuleNotFoundError:
        raise MissingExtra(f"{path}: OCT in a vendor's format", "oct") from None
    if not path.is_file():
        raise BadInput("no such file", path)
    logging.getLogger("eyepy").setLevel(logging.ERROR)  # it logs layers that a file lacks
    reader = getattr(eyepy, EYEPY_FILES[path.suffix.lower()])
    try:
        return getattr(reader, "load", reader)(path)
    except ImportError:
        raise BadInput(
            "Topcon's format needs oct-converter, which installs an OpenCV of its own; "
            "export DICOM, or pip install 'oct-converter<0.7' into a separate environment",
            path,
        ) from None
    except Exception as error:  # eyepy raises anything for a damaged file
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: Exception) -> BadInput:
    reason = " ".join(str(error).split())[:160] or type(error).__name__
    return BadInput(f"not a file that eyepy can read ({reason})", path)
