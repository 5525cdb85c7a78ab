"""A segmentation network of any origin: an ONNX file and a TOML file that specifies its input and classes.

Turns an image into the probability of every class at every pixel of the network's output. It runs on one
thread, so that the same image always gives the same numbers.
"""

import math
from importlib import import_module, resources
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import cv2
import numpy as np
from msgspec import Meta, Struct, field

from haptigraph.errors import BadInput, MissingExtra
from haptigraph.imaging import FloatImage, Floats, grey_of
from haptigraph.messages import Image
from haptigraph.perception.oct.class_edges import PROFILE_VALUES
from haptigraph.toml_document import Document

__all__ = [
    "SHIPPED",
    "EntityClasses",
    "InputSpec",
    "ModelFile",
    "NeedleClass",
    "OnnxModel",
    "SurfaceClass",
]

SHIPPED = "bscan_unet.toml"
"""The model that ships with haptigraph, in `haptigraph.models`."""
FORMAT = 1

Index = Annotated[int, Meta(ge=0, le=255)]
Pixels = Annotated[int, Meta(ge=16, le=4096)]


class InputSpec(Struct, frozen=True, forbid_unknown_fields=True):
    """The [input] table: the whole B-scan, resized, its grey values (0 to 255) shifted and scaled."""

    OLD_KEYS: ClassVar[dict[str, str]] = {"deviation_grey": "sd_grey"}

    width_px: Pixels
    height_px: Pixels
    mean_grey: float = 0.0
    sd_grey: Annotated[float, Meta(gt=0)] = 255.0


class NeedleClass(Struct, frozen=True, forbid_unknown_fields=True):
    """The [entity.needle] table."""

    index: Index = field(name="class")
    least_confidence: Annotated[float, Meta(gt=0, lt=1)] | None = None
    """Minimum probability of a visible needle, which is a rare class; None: that of the model."""


class SurfaceClass(Struct, frozen=True, forbid_unknown_fields=True):
    """The [entity.ilm] and [entity.rpe] tables: the border between two classes, or a class drawn on it."""

    between: tuple[Index, Index] | None = None
    """The classes above and below the surface."""
    line: Index | None = None
    upper_edge: bool = False
    """Whether it is the upper edge of a bright band, and no other such edge is just above it in tissue."""
    confirmed_by: str = ""
    """ONNX file, in the same folder, of a network that judges the surface by profiles of grey across it."""

    def __post_init__(self) -> None:
        if (self.between is None) == (self.line is None):
            raise ValueError("expected either between = [ABOVE, BELOW] or line = CLASS")
        if self.confirmed_by and not self.upper_edge:
            raise ValueError("confirmed_by needs upper_edge = true")

    @property
    def indices(self) -> tuple[int, ...]:
        """All classes that it names."""
        return self.between or (self.line or 0,)


class EntityClasses(Struct, frozen=True, forbid_unknown_fields=True):
    """The [entity] tables; a model need not have all of them."""

    needle: NeedleClass | None = None
    ilm: SurfaceClass | None = None
    rpe: SurfaceClass | None = None


class ModelFile(Struct, frozen=True, forbid_unknown_fields=True):
    """The TOML file of a model."""

    format: int
    file: str
    """The ONNX file, in the same folder."""
    classes: Annotated[int, Meta(ge=2, le=256)]
    """Number of classes."""
    input: InputSpec
    entity: EntityClasses
    values: Literal["probabilities", "logits"] = "logits"
    least_confidence: Annotated[float, Meta(gt=0, lt=1)] = 0.5
    """Minimum probability of a visible surface or needle."""


class OnnxModel:
    """Run a network with ONNX Runtime.

    Args:
        path: Path of the TOML file; empty: the model that ships with haptigraph.

    Raises:
        MissingExtra: If ONNX Runtime is not installed.
        BadInput: If TOML file or network cannot be read, or contradict each other.
    """

    def __init__(self, path: str = "") -> None:
        self._toml = Path(path) if path else Path(str(resources.files("haptigraph.models") / SHIPPED))
        if self._toml.suffix.lower() == ".onnx":
            raise BadInput("this is the network; give the TOML file that describes its classes", path)
        self._document = Document.read(self._toml)
        self.spec = self._checked_spec()
        try:
            runtime = import_module("onnxruntime")
        except ModuleNotFoundError:
            raise MissingExtra("perceiver segmentation", "onnx") from None
        self._session = self._open_session(runtime, self.spec.file, "file")
        rpe = self.spec.entity.rpe
        second = rpe.confirmed_by if rpe is not None else ""
        self._second: Any = self._open_second(runtime, second) if second else None
        self._input, self._channels = self._checked_input()
        self._check_output()

    def __call__(self, image: Image) -> FloatImage:
        """Return the probability of each class, (classes, h, w), h and w those of the network's output."""
        expected = self.spec.input
        grey = grey_of(image)
        size_px = expected.width_px, expected.height_px
        if grey.shape != size_px[::-1]:
            smaller = grey.shape[1] > size_px[0] or grey.shape[0] > size_px[1]
            grey = np.asarray(
                cv2.resize(grey, size_px, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR),
                np.uint8,
            )
        scaled = (grey.astype(np.float32) - np.float32(expected.mean_grey)) / np.float32(expected.sd_grey)
        return self._run(scaled)

    def too_deep(self, profiles: FloatImage) -> Floats:
        """Return the probability that an RPE with such profiles of grey is too deep, (n,).

        Only for a model with `confirmed_by`.

        Args:
            profiles: Of neighbouring columns, from left to right, (n, values); zeros where there is no RPE.
        """
        logits = self._second.run(None, {self._second.get_inputs()[0].name: profiles})[0]
        return np.asarray(1 / (1 + np.exp(-np.clip(logits[:, 0], -50, 50))), np.float64)

    def _run(self, scaled: FloatImage) -> FloatImage:
        batch = np.broadcast_to(scaled, (1, self._channels, *scaled.shape))
        values = self._session.run(None, {self._input: np.ascontiguousarray(batch)})[0]
        maps = np.asarray(values[0], np.float32)
        return maps if self.spec.values == "probabilities" else _softmax(maps)

    def _checked_spec(self) -> ModelFile:
        spec = self._document.convert(ModelFile)
        if spec.format != FORMAT:
            raise self._document.error(
                f"format {spec.format} is not supported; this version reads {FORMAT}", "format"
            )
        entities = {name: getattr(spec.entity, name) for name in EntityClasses.__struct_fields__}
        named = {name: entity for name, entity in entities.items() if entity is not None}
        if not named:
            raise self._document.error(f"no entity has a class; valid: {', '.join(entities)}", "entity")
        for name, entity in named.items():
            for index in entity.indices if isinstance(entity, SurfaceClass) else (entity.index,):
                if index >= spec.classes:
                    raise self._document.error(
                        f"entity.{name}: expected a class from 0 to {spec.classes - 1}, found {index}",
                        "entity",
                    )
        return spec

    def _open_second(self, runtime: Any, name: str) -> Any:
        session = self._open_session(runtime, name, "entity.rpe.confirmed_by")
        count = PROFILE_VALUES
        try:
            values = session.run(None, {session.get_inputs()[0].name: np.zeros((2, count), np.float32)})[0]
        except Exception as error:  # of any kind that ONNX Runtime raises
            reason = " ".join(str(error).split())[:200]
            raise BadInput(f"{name} fails on profiles of {count} values ({reason})", self._toml) from None
        if values.shape != (2, 1):
            raise self._document.error(
                f"{name} returns {_shape_text(values.shape)} for two profiles; expected 2 x 1",
                "entity.rpe.confirmed_by",
            )
        return session

    def _open_session(self, runtime: Any, name: str, key: str) -> Any:
        file = self._toml.parent / name
        if not file.is_file():
            raise self._document.error(f"no such file: {file}; put the network beside its TOML file", key)
        options = runtime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.use_deterministic_compute = True
        options.log_severity_level = 4
        try:
            return runtime.InferenceSession(file.read_bytes(), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # ONNX Runtime raises its own kinds for damaged or unsupported files
            reason = " ".join(str(error).split())[:200]
            raise BadInput(f"not a network that ONNX Runtime can run ({reason})", file) from None

    def _checked_input(self) -> tuple[str, int]:
        expected, given = self.spec.input, self._session.get_inputs()
        shape = given[0].shape if len(given) == 1 else []
        valid = [1, (1, 3), expected.height_px, expected.width_px]
        fits = len(shape) == 4 and all(
            not isinstance(size, int) or size == fit or (isinstance(fit, tuple) and size in fit)
            for size, fit in zip(shape, valid, strict=True)
        )
        if not fits or given[0].type != "tensor(float)":
            found = f"{len(given)} inputs" if len(given) != 1 else f"{given[0].type} of {_shape_text(shape)}"
            raise self._document.error(
                f"the network takes {found}, but [input] specifies tensor(float) of "
                f"1 x 1 x {expected.height_px} x {expected.width_px} (or 3 channels)",
                "input",
            )
        return str(given[0].name), shape[1] if isinstance(shape[1], int) else 1

    def _check_output(self) -> None:
        """Run it once on a blank image: the shapes declared in a file may be symbolic."""
        expected = self.spec.input
        try:
            maps = self._run(np.zeros((expected.height_px, expected.width_px), np.float32))
        except Exception as error:  # of any kind that ONNX Runtime raises
            reason = " ".join(str(error).split())[:200]
            raise BadInput(f"{self.spec.file} fails on its [input] ({reason})", self._toml) from None
        if maps.ndim != 3 or len(maps) != self.spec.classes:
            raise self._document.error(
                f"the network returns {_shape_text((1, *maps.shape))}; expected one map for each of the "
                f"{self.spec.classes} classes, 1 x {self.spec.classes} x height x width",
                "classes",
            )
        sums = maps.sum(axis=0)
        if not (
            np.isfinite(maps).all() and maps.min() >= -1e-3 and math.isclose(sums.mean(), 1, abs_tol=1e-2)
        ):
            raise self._document.error(
                'the network does not return probabilities that sum to 1; set values = "logits" for logits',
                "values",
            )


def _softmax(logits: FloatImage) -> FloatImage:
    powers = np.exp(logits - logits.max(axis=0))
    return np.asarray(powers / powers.sum(axis=0), np.float32)


def _shape_text(shape: Any) -> str:
    return " x ".join(str(size) for size in shape)
