"""Registration of B-scans: check size, axial and lateral scale, and the target's depth in a TOML file.

The eye frame of a B-scan has its origin at the image centre, x to the right, y up against the beam.
Perception finds the anatomy in each image, because the retina moves. docs/oct.md describes the format.
"""

from typing import ClassVar

import numpy as np
from msgspec import Struct

from haptigraph.errors import BadInput
from haptigraph.geometry import ImageGeometry
from haptigraph.messages import Image
from haptigraph.registration.assumed import TARGET, check_assumed
from haptigraph.registration.registered import BaseRegistration
from haptigraph.registration.text import AXIAL_MM_PER_PX, LATERAL_MM_PER_PX, check_format
from haptigraph.toml_document import Document

__all__ = ["ScanRegistration", "check_fits", "scan_registration"]

MIN_SIZE_PX = 64


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
    assumed: tuple[str, ...] = ()


class ScanRegistration(BaseRegistration, frozen=True):
    """The scale of one scanner's B-scans."""

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
            raise BadInput(f"expected one B-scan, (rows, columns), found a volume of {shape}")
        if image is not None and image.dtype != np.uint8:
            raise BadInput(f"expected a B-scan of 8 bits, grey 0 to 255, found {image.dtype} values")
        return BaseRegistration.checked(self, image)


def check_fits(name: str, needs_scan: bool, registration: BaseRegistration) -> None:
    """Check that a perceiver can process the kind of images that a registration describes.

    Args:
        name: Name of the perceiver.
        needs_scan: Whether it processes B-scans.
        registration: The registration it is to use.

    Raises:
        BadInput: If it cannot.
    """
    if needs_scan and not isinstance(registration, ScanRegistration):
        raise BadInput(
            f"perceiver {name} needs the scale of B-scans, a registration with [scale] axial_mm_per_px and "
            "lateral_mm_per_px; this one describes an eye before a camera"
        )
    if not needs_scan and isinstance(registration, ScanRegistration):
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
    for key, length in (("width", data.image.width), ("height", data.image.height)):
        if length < MIN_SIZE_PX:
            problem = f"a {key} of {length} px is too small; B-scans have at least {MIN_SIZE_PX} px"
            raise document.error(problem, f"image.{key}")
    bounds = {"axial_mm_per_px": AXIAL_MM_PER_PX, "lateral_mm_per_px": LATERAL_MM_PER_PX}
    for key, (low, high) in bounds.items():
        value = getattr(data.scale, key)
        if not low <= value <= high:
            problem = f"{key} of {value:g} is implausible; scanners have {low:g} to {high:g} mm"
            raise document.error(problem, f"scale.{key}")
    if not 0 < data.target.depth_share < 1:
        problem = f"depth_share must be between 0 (ILM) and 1 (RPE), found {data.target.depth_share:g}"
        raise document.error(problem, "target.depth_share")
    assumed = data.assumed if "target" in document.data else (*data.assumed, TARGET)
    center_px = (data.image.width - 1) / 2, (data.image.height - 1) / 2
    scale = data.scale
    return ScanRegistration(
        width_px=data.image.width,
        height_px=data.image.height,
        image=ImageGeometry(
            center_px, scale.lateral_mm_per_px, data.image.mirrored, axial_mm_per_px=scale.axial_mm_per_px
        ),
        text=document.text,
        target_share=data.target.depth_share,
        assumed=check_assumed(document, assumed),
    )
