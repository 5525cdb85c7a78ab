"""The file of an instrument's model: NumPy's .npz with a version and a fingerprint."""

import hashlib
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from haptigraph.errors import BadInput
from haptigraph.perception.instrument.model import InstrumentModel

__all__ = ["check_suffix", "fingerprint", "load_instrument", "save_instrument"]

FORMAT, VERSION = "haptigraph instrument", 1
LEARN_AGAIN = "learn it again with: haptigraph register --volumes FOLDER -o FILE"

_SHAPES: dict[str, tuple[str, tuple[int | None, ...]]] = {
    "voxel_mm": ("float64", (3,)),
    "is_usable": ("bool", (None,)),
    "points_mm": ("float32", (None, 3)),
    "values": ("float32", (None,)),
    "gradients": ("float32", (None, 3)),
    "axis": ("float64", (3,)),
    "bevel": ("float64", (3,)),
    "start_mm": ("float64", (3,)),
    "level": ("float64", ()),
    "cost_limit": ("float64", ()),
    "tip_sd_mm": ("float64", (3,)),
    "axis_sd_deg": ("float64", ()),
    "roll_sd_deg": ("float64", ()),
    "volumes": ("int64", ()),
}
"""Type and shape of each field; None: any length."""
POSITIVE = ("voxel_mm", "level", "cost_limit", "tip_sd_mm", "axis_sd_deg", "roll_sd_deg", "volumes")


def save_instrument(model: InstrumentModel, path: str | Path, *, force: bool = False) -> None:
    """Write a model.

    Raises:
        BadInput: If the file exists and is not to be overwritten, or cannot be written.
    """
    file = Path(path)
    check_suffix(file)
    arrays = _arrays(model)
    try:
        with file.open("wb" if force else "xb") as stream:
            np.savez_compressed(
                stream,
                format=FORMAT,
                version=VERSION,
                fingerprint=_sha256(arrays),
                **arrays,  # type: ignore[arg-type]
            )
    except FileExistsError:
        raise BadInput("exists already; --force overwrites it", file) from None
    except OSError as error:
        raise BadInput(f"cannot be written ({error.strerror})", file) from None


def check_suffix(file: Path) -> None:
    """Refuse a name that is not an instrument's.

    Raises:
        BadInput: If it does not end in .npz.
    """
    if file.suffix != ".npz":
        raise BadInput("the name of an instrument's file ends in .npz", file)


def load_instrument(path: str | Path) -> InstrumentModel:
    """Read a model.

    Raises:
        BadInput: If the file is missing, damaged or no model that this version reads.
    """
    try:
        with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            found = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise BadInput("no such file", path) from None
    except (
        OSError,
        ValueError,
        EOFError,
        zipfile.BadZipFile,
        zlib.error,
        TypeError,
        AttributeError,
    ) as error:
        raise BadInput(f"is not a readable .npz file ({error}); {LEARN_AGAIN}", path) from None
    if str(found.get("format")) != FORMAT:
        raise BadInput(f"is not the model of an instrument; {LEARN_AGAIN}", path)
    if str(found.get("version")) != str(VERSION):
        raise BadInput(f"has version {found.get('version')}; valid: {VERSION}; {LEARN_AGAIN}", path)
    arrays = {name: _checked(name, found.get(name), path) for name in _SHAPES}
    if str(found.get("fingerprint")) != _sha256(arrays):
        raise BadInput(f"was changed after it was learned: its fingerprint differs; {LEARN_AGAIN}", path)
    points = len(arrays["points_mm"])
    if not points or len(arrays["values"]) != points or len(arrays["gradients"]) != points:
        raise BadInput(f"has {points} points, but other numbers of values or gradients; {LEARN_AGAIN}", path)
    values: dict[str, Any] = {name: array if array.ndim else array.item() for name, array in arrays.items()}
    axial_mm, slice_mm, column_mm = map(float, values.pop("voxel_mm"))
    return InstrumentModel(voxel_mm=(axial_mm, slice_mm, column_mm), **values)


def fingerprint(model: InstrumentModel) -> str:
    """Return the SHA-256 of everything that a model contains."""
    return _sha256(_arrays(model))


def _arrays(model: InstrumentModel) -> dict[str, np.ndarray[Any, Any]]:
    return {
        name: np.ascontiguousarray(np.asarray(getattr(model, name), dtype)).reshape(
            np.shape(getattr(model, name))
        )
        for name, (dtype, _) in _SHAPES.items()
    }


def _checked(name: str, array: Any, path: str | Path) -> "np.ndarray[Any, Any]":
    dtype, shape = _SHAPES[name]
    if array is None:
        raise BadInput(f"lacks {name}; {LEARN_AGAIN}", path)
    fits = array.ndim == len(shape) and all(
        want in (None, size) for want, size in zip(shape, array.shape, strict=True)
    )
    if str(array.dtype) != dtype or not fits:
        wanted = "x".join("n" if size is None else str(size) for size in shape) or "one number"
        raise BadInput(f"{name}: expected {dtype} ({wanted}); found {array.dtype} {array.shape}", path)
    if not np.isfinite(array).all() or (name in POSITIVE and not (array > 0).all()):
        valid = "positive numbers" if name in POSITIVE else "finite numbers"
        raise BadInput(f"{name}: expected {valid}", path)
    return np.ascontiguousarray(array).reshape(array.shape)


def _sha256(arrays: "dict[str, np.ndarray[Any, Any]]") -> str:
    digest = hashlib.sha256(f"{FORMAT} {VERSION}".encode())
    for name in sorted(arrays):
        digest.update(f"{name} {arrays[name].dtype} {arrays[name].shape}".encode())
        digest.update(arrays[name].tobytes())
    return digest.hexdigest()
