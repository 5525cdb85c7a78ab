"""Registration of B-scans and volumes: check size, scale and the target's depth in a TOML file.

The eye frame of a B-scan has its origin at the image centre, x to the right, y up against the beam; that of a
volume at its centre, with z along its B-scans, the last one nearest to the viewer.
Perception finds the anatomy in each image, because the retina moves. docs/explanation/oct.md describes
the format.
"""

from typing import ClassVar

import numpy as np
from msgspec import Struct

from haptigraph.errors import BadInput
from haptigraph.messages import Image, ImageKind, Volume
from haptigraph.projection import ImageGeometry, Slices
from haptigraph.registration.assumed import TARGET, check_assumed
from haptigraph.registration.registered import BaseRegistration
from haptigraph.registration.text import AXIAL_MM_PER_PX, LATERAL_MM_PER_PX, SLICE_MM, check_format
from haptigraph.toml_document import Document

__all__ = ["ScanRegistration", "check_fits", "scan_registration"]

MIN_SIZE_PX, MIN_SLICES = 64, 4
MIN_COLUMNS = 16
"""Of the B-scans of a volume, which are narrower than single ones."""


class _Image(Struct, frozen=True, forbid_unknown_fields=True):
    width: int
    height: int
    mirrored: bool = False


class _Scale(Struct, frozen=True, forbid_unknown_fields=True):
    axial_mm_per_px: float
    lateral_mm_per_px: float


class _Target(Struct, frozen=True, forbid_unknown_fields=True):
    depth_share: float = 0.6


class _Volume(Struct, frozen=True, forbid_unknown_fields=True):
    slices: int
    slice_mm: float


class _File(Struct, frozen=True, forbid_unknown_fields=True):
    format: int
    image: _Image
    scale: _Scale
    volume: _Volume | None = None
    target: _Target = _Target()
    assumed: tuple[str, ...] = ()


class ScanRegistration(BaseRegistration, frozen=True):
    """The scale of one scanner's B-scans or volumes."""

    how_to_state: ClassVar[str] = "state target.depth_share in a registration file"
    target_share: float
    """Depth of the target between the ILM (0) and the RPE (1)."""

    def checked(self, image: Image | None) -> Image:
        """Return an image if it is a B-scan of the registered size.

        Raises:
            BadInput: If it is not.
        """
        if image is not None and (image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3)):
            shape = " x ".join(str(length) for length in image.shape)
            raise BadInput(f"expected one B-scan, (rows, columns), found an array of {shape}")
        if image is not None and image.dtype != np.uint8:
            raise BadInput(f"expected a B-scan of 8 bits, grey 0 to 255, found {image.dtype} values")
        return BaseRegistration.checked(self, image)

    def checked_volume(self, image: Image | None) -> Volume:
        """Return a volume, (rows, slices, columns), from its B-scans side by side.

        Raises:
            BadInput: If the image is not a grey volume of the registered size.
        """
        slices, checked = self.image.slices, self.checked(image)
        if slices is None or checked.ndim != 2:
            raise BadInput("expected a grey volume, its B-scans side by side, found a single B-scan")
        return checked.reshape(self.height_px, slices.count, slices.columns)

    @property
    def voxel_mm(self) -> tuple[float, float, float]:
        """Size of a voxel of a volume along (rows, slices, columns)."""
        image = self.image
        axial_mm = image.mm_per_px if image.axial_mm_per_px is None else image.axial_mm_per_px
        return axial_mm, image.slices.spacing_mm if image.slices else 0.0, image.mm_per_px


def check_fits(name: str, needs: ImageKind, registration: BaseRegistration) -> None:
    """Check that a perceiver can process the kind of images that a registration describes.

    Args:
        name: Name of the perceiver.
        needs: What it processes.
        registration: The registration it is to use.

    Raises:
        BadInput: If it cannot.
    """
    is_scan = isinstance(registration, ScanRegistration)
    found = "eye" if not is_scan else "bscan" if registration.image.slices is None else "volume"
    if found == needs:
        return
    if found == "volume":
        raise BadInput(
            f"perceiver {name} does not process volumes, and this registration has [volume]; try --procedure "
            "subretinal_injection_4d, or play single B-scans with --set source.volume_as_sequence=true"
        )
    if found == "bscan" and needs == "volume":
        raise BadInput(
            f"perceiver {name} needs volumes, a registration with [volume] slices and slice_mm; this one is "
            "for single B-scans; try --procedure subretinal_injection_ioct"
        )
    if found == "eye":
        raise BadInput(
            f"perceiver {name} needs the scale of B-scans, a registration with [scale] axial_mm_per_px and "
            "lateral_mm_per_px; this one describes an eye before a camera"
        )
    raise BadInput(
        f"perceiver {name} needs an eye before a camera, with globe and trocar; this registration is the "
        "scale of B-scans; try --procedure subretinal_injection_ioct"
    )


def scan_registration(document: Document) -> ScanRegistration:
    """Check the registration of B-scans.

    Raises:
        BadInput: With file, line and reason, if it is not valid.
    """
    data = document.convert(_File)
    check_format(document, data.format)
    volume = data.volume
    least_px = MIN_SIZE_PX if volume is None else MIN_COLUMNS
    for key, length in (("width", data.image.width), ("height", data.image.height)):
        if length < least_px:
            kind = "B-scans" if volume is None else "B-scans of a volume"
            problem = f"a {key} of {length} px is too small; {kind} have at least {least_px} px"
            raise document.error(problem, f"image.{key}")
    if volume is not None and volume.slices < MIN_SLICES:
        problem = f"a volume of {volume.slices} B-scans is too thin; volumes have at least {MIN_SLICES}"
        raise document.error(problem, "volume.slices")
    bounds = [
        ("scale.axial_mm_per_px", data.scale.axial_mm_per_px, AXIAL_MM_PER_PX),
        ("scale.lateral_mm_per_px", data.scale.lateral_mm_per_px, LATERAL_MM_PER_PX),
    ]
    if volume is not None:
        bounds.append(("volume.slice_mm", volume.slice_mm, SLICE_MM))
    for place, value, (low, high) in bounds:
        if not low <= value <= high:
            key = place.partition(".")[2]
            problem = f"{key} of {value:g} is implausible; scanners have {low:g} to {high:g} mm"
            raise document.error(problem, place)
    if not 0 < data.target.depth_share < 1:
        problem = f"depth_share must be between 0 (ILM) and 1 (RPE), found {data.target.depth_share:g}"
        raise document.error(problem, "target.depth_share")
    assumed = data.assumed if "target" in document.data else (*data.assumed, TARGET)
    center_px = (data.image.width - 1) / 2, (data.image.height - 1) / 2
    scale, count = data.scale, volume.slices if volume else 1
    slices = Slices(volume.slices, volume.slice_mm, data.image.width) if volume else None
    return ScanRegistration(
        width_px=data.image.width * count,
        height_px=data.image.height,
        image=ImageGeometry(
            center_px,
            scale.lateral_mm_per_px,
            data.image.mirrored,
            axial_mm_per_px=scale.axial_mm_per_px,
            slices=slices,
        ),
        text=document.text,
        target_share=data.target.depth_share,
        assumed=check_assumed(document, assumed),
    )
