"""The file of a calibrated lens, lens.toml: read, check and turn it; registrations keep its table [lens]."""

import json
from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.imaging import Turn
from haptigraph.lens import Lens
from haptigraph.registration.text import lens_table
from haptigraph.toml_document import Document

__all__ = ["LensFile", "LensImage", "Parameters", "Quality", "check_lens", "lens_file_text", "load_lens"]

FOCAL_RATIO = (0.2, 50.0)  # of the focal length to the image's width: 136 to 1.1 degrees of view
MAX_ASPECT = 1.1


class LensImage(Struct, frozen=True, forbid_unknown_fields=True):
    """The size of the images, as the camera takes them [px]."""

    width: int
    height: int


class Parameters(Struct, frozen=True, forbid_unknown_fields=True):
    """A number for every parameter of a lens."""

    focal_px: tuple[float, float]
    principal_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float]


class Quality(Struct, frozen=True, forbid_unknown_fields=True):
    """How well the views fit."""

    rms_px: float
    views: int
    coverage: float
    """Share of the image's parts in which the sheet was seen."""


class LensFile(Struct, frozen=True, forbid_unknown_fields=True):
    """The contents of lens.toml."""

    format: int
    image: LensImage
    lens: Lens
    camera: str = ""
    """What was calibrated."""
    parameter_sd: Parameters | None = None
    """Standard deviations, from the residuals of the calibration."""
    quality: Quality | None = None

    def for_images(self, size_px: tuple[int, int], turn: Turn, file: str) -> Lens:
        """Return the lens for images that were turned.

        Args:
            size_px: Their (width, height).
            turn: How they were turned; the file is for images as the camera takes them.
            file: Name of the file in errors.

        Raises:
            BadInput: If they have another size than those of the calibration.
        """
        size = self.image.width, self.image.height
        needed = turn.size_before_px(size_px)
        if needed != size:
            raise BadInput(
                f"is for images of {size[0]} x {size[1]} px, but the camera's have "
                f"{needed[0]} x {needed[1]} px; calibrate at the size that you use",
                file,
            )
        return _turned(self.lens, size, turn)


def load_lens(path: str | Path) -> LensFile:
    """Read lens.toml.

    Raises:
        BadInput: If it cannot be read or is not valid.
    """
    document = Document.read(path)
    data = document.convert(LensFile)
    if data.format != 1:
        raise document.error(f"unknown format {data.format}; this version reads format 1", "format")
    check_lens(document, data.lens, data.image.width, data.image.height)
    return data


def lens_file_text(file: LensFile) -> str:
    """Return the text of lens.toml."""
    text = f"""# Lens of a camera, calibrated by haptigraph.
format = 1
camera = {_string(file.camera)}

[image]  # as the camera takes them
width = {file.image.width}
height = {file.image.height}
{lens_table(file.lens)}"""
    if (sd := file.parameter_sd) is not None:
        text += f"""
[parameter_sd]  # standard deviations, from the residuals
focal_px = {_list(sd.focal_px)}
principal_px = {_list(sd.principal_px)}
distortion = {_list(sd.distortion)}
"""
    if (quality := file.quality) is not None:
        text += f"""
[quality]
rms_px = {quality.rms_px:.3f}
views = {quality.views}
coverage = {quality.coverage:.3f}
"""
    return text


def check_lens(document: Document, lens: Lens, width_px: int, height_px: int) -> None:
    """Refuse a lens that no camera with images of this size has.

    Raises:
        BadInput: With the key that is wrong.
    """
    low, high = FOCAL_RATIO[0] * width_px, FOCAL_RATIO[1] * width_px
    across, down = lens.focal_px
    if not (low <= across <= high and low <= down <= high and 1 / MAX_ASPECT <= across / down <= MAX_ASPECT):
        raise document.error(
            f"focal lengths of {across:g} and {down:g} px are implausible; {low:.0f} to {high:.0f} px, "
            f"within {MAX_ASPECT - 1:.0%} of each other, are plausible",
            "lens.focal_px",
        )
    x, y = lens.principal_px
    if not (0 <= x < width_px and 0 <= y < height_px):
        raise document.error(
            f"the principal point ({x:g}, {y:g}) px is outside the {width_px} x {height_px} px image",
            "lens.principal_px",
        )
    if not lens.is_invertible(width_px, height_px):
        raise document.error(
            "the distortion maps two points to one place in the image; calibrate the camera again",
            "lens.distortion",
        )


def _string(text: str) -> str:
    """Return a TOML string, which has the escapes of JSON."""
    return json.dumps(text)


def _list(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{value:.3g}' for value in map(float, values))}]"


def _turned(lens: Lens, size_px: tuple[int, int], turn: Turn) -> Lens:
    """Return the lens as it is in turned images; `size_px` is that before the turn."""
    width, height = size_px
    for _ in range(turn.rotate_deg // 90):
        (x, y), (k1, k2, p1, p2, k3) = lens.principal_px, lens.distortion
        lens = replace(
            lens,
            focal_px=lens.focal_px[::-1],
            principal_px=(height - 1 - y, x),
            distortion=(k1, k2, p2, -p1, k3),
        )
        width, height = height, width
    if turn.mirror:
        (x, y), (k1, k2, p1, p2, k3) = lens.principal_px, lens.distortion
        lens = replace(lens, principal_px=(width - 1 - x, y), distortion=(k1, k2, p1, -p2, k3))
    return lens
