"""Registration of B-scans: their size and scale, axial and lateral apart, and how deep the target lies.

Read from TOML and checked. The eye frame of a B-scan has its origin in the image's middle, x right, y up
against the beam. Everything else is found in each image: the retina moves. The format is described in
docs/oct.md.
"""

from pathlib import Path

import numpy as np
from msgspec import Struct

from haptigraph.errors import BadInput
from haptigraph.geometry import ImageGeometry
from haptigraph.messages import Image
from haptigraph.registration.camera import Registration, registration_of
from haptigraph.registration.registered import Registered
from haptigraph.registration.text import AXIAL_MM_PER_PX, FORMAT, LATERAL_MM_PER_PX
from haptigraph.toml_document import Document

__all__ = ["ScanRegistration", "check_fits", "load_registered", "parse_registered"]

SMALLEST_PX = 64


class _Image(Struct, frozen=True, forbid_unknown_fields=True):
    width: int
    height: int
    mirrored: bool = False


class _Scale(Struct, frozen=True, forbid_unknown_fields=True):
    axial_mm_per_px: float
    lateral_mm_per_px: float


class _Target(Struct, frozen=True, forbid_unknown_fields=True):
    depth_share: float = 0.6


class _File(Struct, frozen=True, forbid_unknown_fields=True):
    format: int
    image: _Image
    scale: _Scale
    target: _Target = _Target()


class ScanRegistration(Registered, frozen=True):
    """The scale of one scanner's B-scans."""

    target_share: float
    """Of the way from ILM to RPE: how deep the needle is to go."""

    def checked(self, image: Image | None) -> Image:
        """Return an image if it is a B-scan of the registered size.

        Raises:
            BadInput: If not.
        """
        if image is not None and (image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3)):
            shape = " x ".join(str(length) for length in image.shape)
            raise BadInput(f"expected one B-scan, (rows, columns), found a volume of {shape}")
        if image is not None and image.dtype != np.uint8:
            raise BadInput(f"expected a B-scan of 8 bits, grey 0 to 255, found {image.dtype} values")
        return Registered.checked(self, image)


def load_registered(path: str | Path) -> Registered:
    """Read and check a registration of either kind: of an eye, or of B-scans.

    Raises:
        BadInput: With file, line and reason, if it cannot be read or makes no sense.
    """
    return _registered(Document.read(path))


def parse_registered(text: str, file: str) -> Registered:
    """Read and check a registration of either kind from text; `file` names it in errors."""
    return _registered(Document(text, file))


def check_fits(name: str, needs_scan: bool, registration: Registered) -> None:
    """Check that a perceiver is made for the images that a registration is of.

    Args:
        name: Of the perceiver.
        needs_scan: Whether it processes B-scans.
        registration: What it is to be given.

    Raises:
        BadInput: If not.
    """
    if needs_scan and not isinstance(registration, ScanRegistration):
        raise BadInput(
            f"perceiver {name} needs the scale of B-scans, a registration with [scale] axial_mm_per_px and "
            "lateral_mm_per_px; this one is of an eye before a camera"
        )
    if not needs_scan and isinstance(registration, ScanRegistration):
        raise BadInput(
            f"perceiver {name} needs an eye before a camera, with globe and trocar; this registration is the "
            "scale of B-scans; try --procedure subretinal_injection_ioct"
        )


def _registered(document: Document) -> Registration | ScanRegistration:
    return _scan(document) if "scale" in document.data else registration_of(document)


def _scan(document: Document) -> ScanRegistration:
    data = document.convert(_File)
    if data.format != FORMAT:
        problem = f"format {data.format} is not known; this version reads format {FORMAT}"
        raise document.error(problem, "format")
    for key, length in (("width", data.image.width), ("height", data.image.height)):
        if length < SMALLEST_PX:
            problem = f"a {key} of {length} px; B-scans have at least {SMALLEST_PX}"
            raise document.error(problem, f"image.{key}")
    bounds = {"axial_mm_per_px": AXIAL_MM_PER_PX, "lateral_mm_per_px": LATERAL_MM_PER_PX}
    for key, (low, high) in bounds.items():
        value = getattr(data.scale, key)
        if not low <= value <= high:
            problem = f"{key} of {value:g} is implausible; {low:g} to {high:g} mm is what scanners have"
            raise document.error(problem, f"scale.{key}")
    if not 0 < data.target.depth_share < 1:
        problem = f"depth_share must lie between 0 (ILM) and 1 (RPE), found {data.target.depth_share:g}"
        raise document.error(problem, "target.depth_share")
    middle_px = (data.image.width - 1) / 2, (data.image.height - 1) / 2
    scale = data.scale
    return ScanRegistration(
        width_px=data.image.width,
        height_px=data.image.height,
        image=ImageGeometry(
            middle_px, scale.lateral_mm_per_px, data.image.mirrored, axial_mm_per_px=scale.axial_mm_per_px
        ),
        text=document.text,
        target_share=data.target.depth_share,
    )
