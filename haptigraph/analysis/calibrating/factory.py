"""The lens as the RealSense SDK reports it: the calibration of the camera's manufacturer."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from haptigraph.errors import BadInput
from haptigraph.lens import Lens
from haptigraph.sources.cameras.realsense_sdk import colour_stream, find_device, info_of, sdk

__all__ = ["factory_lens", "lens_of"]

GRID = 21  # rays either way
MAX_MISFIT_PX = 0.05
FORWARD = ("none", "brown_conrady")


def factory_lens(
    kind: str, argument: str, size_px: tuple[int, int] | None, rate_hz: float | None
) -> tuple[Lens, tuple[int, int], str]:
    """Return the lens of a RealSense camera or of a recording of the SDK, the images' size, and its name.

    Args:
        kind: "realsense" or "realsense-file".
        argument: Serial number, or empty; or the file's path.
        size_px: (width, height) of the images; None: as recorded.
        rate_hz: Images per second; None: as recorded.

    Raises:
        MissingExtra: If the SDK is not installed.
        BadInput: If there is no such camera or file, or its lens has another model.
    """
    context = sdk().context()  # must outlive the device
    try:
        if kind == "realsense":
            device = find_device(argument)
        elif Path(argument).is_file():
            device = context.load_device(argument)
        else:
            raise BadInput("no such file", argument)
        _, profile = colour_stream(f"{kind}:{argument}", device, size_px, rate_hz)
        intrinsics = profile.get_intrinsics()
    except RuntimeError as error:
        raise BadInput(f"the RealSense SDK cannot read {kind}:{argument} ({error})") from None
    name = "RealSense camera"
    with suppress(RuntimeError):
        name = f"{info_of(device, 'name')}, serial number {info_of(device, 'serial_number')}"
    return lens_of(intrinsics), (intrinsics.width, intrinsics.height), name


def lens_of(intrinsics: Any) -> Lens:
    """Convert intrinsics of the SDK.

    Raises:
        BadInput: If their distortion model is none that corresponds to a `Lens`.
    """
    model, coefficients = intrinsics.model.name, [float(value) for value in intrinsics.coeffs]
    lens = Lens((intrinsics.fx, intrinsics.fy), (intrinsics.ppx, intrinsics.ppy), (0.0,) * 5)
    if model in FORWARD or not any(coefficients):
        return Lens(lens.focal_px, lens.principal_px, (*coefficients,))  # type: ignore[arg-type]
    if model != "inverse_brown_conrady":
        raise BadInput(f"the SDK reports the lens model {model}; calibrate with a sheet instead")
    return _inverted(lens, coefficients, intrinsics.width, intrinsics.height)


def _inverted(lens: Lens, coefficients: list[float], width_px: int, height_px: int) -> Lens:
    """Fit the distortion whose inverse has given coefficients; the model is linear in its own."""
    (across, down), (right, below) = lens.focal_px, lens.principal_px
    axes = np.linspace(0, width_px - 1, GRID), np.linspace(0, height_px - 1, GRID)
    x, y = (axis.ravel() for axis in np.meshgrid(*axes))
    bent = np.stack([(x - right) / across, (y - below) / down], axis=1)
    ideal = bent + np.einsum("nij,j->ni", _terms(bent), coefficients)
    terms, offsets = _terms(ideal), bent - ideal
    fitted = np.linalg.lstsq(terms.reshape(-1, 5), offsets.ravel(), rcond=None)[0]
    misfit_px = float(np.abs((terms @ fitted - offsets) * (across, down)).max())
    if misfit_px > MAX_MISFIT_PX:
        raise BadInput(
            f"the SDK's lens model can be converted only to {misfit_px:.2f} px; calibrate with a sheet"
        )
    return Lens(lens.focal_px, lens.principal_px, tuple(fitted.tolist()))


def _terms(points: "np.ndarray[Any, np.dtype[np.float64]]") -> "np.ndarray[Any, np.dtype[np.float64]]":
    """Return what each coefficient adds to x and y of points at unit distance, (n, 2, 5)."""
    x, y = points.T
    squared = x**2 + y**2
    return np.stack(
        [
            np.stack([x * squared, y * squared], axis=1),
            np.stack([x * squared**2, y * squared**2], axis=1),
            np.stack([2 * x * y, squared + 2 * y**2], axis=1),
            np.stack([squared + 2 * x**2, 2 * x * y], axis=1),
            np.stack([x * squared**3, y * squared**3], axis=1),
        ],
        axis=2,
    )
