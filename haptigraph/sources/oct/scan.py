"""What an OCT file says of its B-scans: their scale, and whether they are a film or a volume.

Reads headers of DICOM files (pydicom) and whole files of Heidelberg and Topcon (eyepy). A scale that a file
does not state is not guessed. Knows nothing of patients.
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

__all__ = ["EYEPY_FILES", "EyepySource", "ScanFacts", "dicom_facts"]

EYEPY_FILES = {
    ".vol": "import_heyex_vol",
    ".e2e": "import_heyex_e2e",
    ".xml": "import_heyex_xml",
    ".fda": "import_topcon_fda",
    ".eye": "EyeVolume",
}
"""What eyepy reads, by suffix, and how it calls it."""
NOT_OCT = "Ophthalmic Photography", "Computed Tomography", "CT Image", "MR Image", "Ultrasound"


class ScanFacts(Struct, frozen=True):
    """What a file says of its B-scans."""

    axial_mm_per_px: float | None = None
    """Height of a pixel; None: it does not say."""
    lateral_mm_per_px: float | None = None
    """Width of a pixel."""
    volume: str = ""
    """Why its images are no film; empty: they are one, or there is but one."""


def dicom_facts(path: Path) -> ScanFacts:
    """Read what a DICOM file says.

    Raises:
        MissingExtra: If pydicom is not installed.
        BadInput: If it cannot be read, or holds pictures of something else.
    """
    try:
        pydicom = import_module("pydicom")
    except ModuleNotFoundError:
        raise MissingExtra(f"{path}: OCT in DICOM", "oct") from None
    try:
        header = pydicom.dcmread(path, stop_before_pixels=True)
        kind = str(getattr(header.get("SOPClassUID"), "name", ""))
        if any(word in kind for word in NOT_OCT):
            raise BadInput(f"holds no OCT but {kind.removesuffix(' Storage')}", path)
        if int(header.get("BitsAllocated") or 8) not in (8, 16):
            raise BadInput(f"stores {header.BitsAllocated} bit per pixel; 8 or 16 are read", path)
        axial_mm, lateral_mm = _spacing_mm(header)
        return ScanFacts(axial_mm, lateral_mm, _why_volume(header))
    except BadInput:
        raise
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", path) from None
    except Exception as error:  # pydicom raises whatever a torn file makes of it
        told = " ".join(str(error).split())
        raise BadInput(f"not a DICOM file that makes sense ({told})", path) from None


def _spacing_mm(header: Any) -> tuple[float | None, float | None]:
    """Return axial and lateral distance of pixels: PixelSpacing names that of the rows first."""
    for item in (header, *_items(header, "PixelMeasuresSequence")):
        spacing = item.get("PixelSpacing")
        if spacing is not None and len(spacing) == 2:
            return float(spacing[0]), float(spacing[1])
    return None, None


def _why_volume(header: Any) -> str:
    count = int(header.get("NumberOfFrames") or 1)
    if count == 1:
        return ""
    places = [
        tuple(float(value) for value in item.get(key))
        for name, key in (
            ("OphthalmicFrameLocationSequence", "ReferenceCoordinates"),
            ("PlanePositionSequence", "ImagePositionPatient"),
        )
        for item in _items(header, name)
        if item.get(key)
    ]
    if len(set(places)) > 1:
        return f"it holds {count} B-scans of different places"
    is_film = any(key in header for key in ("FrameTime", "FrameTimeVector", "CineRate"))
    if places or is_film:
        return ""
    return f"it holds {count} B-scans and does not say that they show one place"


def _items(header: Any, name: str) -> Iterator[Any]:
    """Yield the items of a sequence that belongs to all images, and those that belong to one each."""
    for groups in ("SharedFunctionalGroupsSequence", "PerFrameFunctionalGroupsSequence"):
        for group in header.get(groups) or ():
            yield from group.get(name) or ()


class EyepySource:
    """Read a file of an OCT's maker with eyepy; its B-scans in the order of the file.

    Args:
        path: The file.
        rate_hz: Images per second: these files tell no time.

    Raises:
        MissingExtra: If eyepy is not installed.
        BadInput: If eyepy cannot read the file.
    """

    is_live = False
    registration: str | None = None

    def __init__(self, path: Path, rate_hz: float) -> None:
        self.rate_hz = rate_hz
        self._index = -1
        volume = _read(path)
        try:
            count, height, width = volume.shape
            self._images = np.asarray(volume.data)
            in_mm = volume.scale_unit == "mm"
            axial_mm, lateral_mm = (float(volume.scale_y), float(volume.scale_x)) if in_mm else (None, None)
        except Exception as error:  # eyepy computes lazily, and what is torn fails here
            raise _unreadable(path, error) from None
        if self._images.dtype != np.uint8 or self._images.shape != (count, height, width):
            raise BadInput(f"eyepy shows it as {self._images.dtype}; B-scans of 8 bit were expected", path)
        why = f"it holds {count} B-scans of different places" if count > 1 else ""
        self.facts = ScanFacts(axial_mm, lateral_mm, why)

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next B-scan."""
        self._index += 1
        if self._index >= len(self._images):
            raise EndOfSource
        stamp_ns = round(self._index * 1e9 / self.rate_hz)
        return Capture(self._index, stamp_ns, np.ascontiguousarray(self._images[self._index]))

    def close(self) -> None:
        """Do nothing: the file was read whole."""


def _read(path: Path) -> Any:
    try:
        eyepy = import_module("eyepy")
    except ModuleNotFoundError:
        raise MissingExtra(f"{path}: OCT as its maker stores it", "oct") from None
    if not path.is_file():
        raise BadInput("no such file", path)
    logging.getLogger("eyepy").setLevel(logging.ERROR)  # layers that a file lacks are nobody's business here
    reader = getattr(eyepy, EYEPY_FILES[path.suffix.lower()])
    try:
        return getattr(reader, "load", reader)(path)
    except ImportError:
        raise BadInput(
            "Topcon's format needs oct-converter, which brings an OpenCV of its own; "
            "export DICOM, or pip install 'oct-converter<0.7' into an environment of its own",
            path,
        ) from None
    except Exception as error:  # eyepy raises whatever a torn file makes of it
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: Exception) -> BadInput:
    told = " ".join(str(error).split())[:160] or type(error).__name__
    return BadInput(f"not a file that eyepy can read ({told})", path)
