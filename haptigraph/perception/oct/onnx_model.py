"""A segmentation network of any origin: an ONNX file, and beside it a TOML that says what it wants and means.

Turns an image into the probability of every class at every pixel of the network's output. One thread, so that
the same image always gives the same numbers. Knows no geometry.
"""

import math
from importlib import import_module, resources
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from msgspec import Meta, Struct, field

from haptigraph.errors import BadInput, MissingExtra
from haptigraph.imaging import FloatImage, grey_of
from haptigraph.messages import Image
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
"""The model that comes with haptigraph, in `haptigraph.models`."""
FORMAT = 1

Index = Annotated[int, Meta(ge=0, le=255)]
Pixels = Annotated[int, Meta(ge=16, le=4096)]


class InputSpec(Struct, frozen=True, forbid_unknown_fields=True):
    """The [input] table: the whole B-scan, resized, its grey values (0 to 255) shifted and scaled."""

    width_px: Pixels
    height_px: Pixels
    mean_grey: float = 0.0
    sd_grey: Annotated[float, Meta(gt=0)] = 255.0


class NeedleClass(Struct, frozen=True, forbid_unknown_fields=True):
    """The [entity.needle] table."""

    index: Index = field(name="class")


class SurfaceClass(Struct, frozen=True, forbid_unknown_fields=True):
    """The [entity.ilm] and [entity.rpe] tables: the border between two classes, or a class drawn on it."""

    between: tuple[Index, Index] | None = None
    """What lies above the surface, and what below."""
    line: Index | None = None

    def __post_init__(self) -> None:
        if (self.between is None) == (self.line is None):
            raise ValueError("either between = [ABOVE, BELOW] or line = CLASS says where the surface is")

    @property
    def indices(self) -> tuple[int, ...]:
        """All classes it speaks of."""
        return self.between or (self.line or 0,)


class EntityClasses(Struct, frozen=True, forbid_unknown_fields=True):
    """The [entity] tables; a model need not know all."""

    needle: NeedleClass | None = None
    ilm: SurfaceClass | None = None
    rpe: SurfaceClass | None = None


class ModelFile(Struct, frozen=True, forbid_unknown_fields=True):
    """The TOML beside a model."""

    format: int
    file: str
    """The ONNX file, in the same folder."""
    classes: Annotated[int, Meta(ge=2, le=256)]
    """How many the network tells apart."""
    input: InputSpec
    entity: EntityClasses
    values: Literal["probabilities", "logits"] = "logits"
    least_confidence: Annotated[float, Meta(gt=0, lt=1)] = 0.5
    """What is less probable does not count as seen."""


class OnnxModel:
    """Run a network with ONNX Runtime.

    Args:
        path: Of the TOML; empty: the model that ships with haptigraph.

    Raises:
        MissingExtra: If ONNX Runtime is not installed.
        BadInput: If TOML or network cannot be read, or contradict each other.
    """

    def __init__(self, path: str = "") -> None:
        self._toml = Path(path) if path else Path(str(resources.files("haptigraph.models") / SHIPPED))
        if self._toml.suffix.lower() == ".onnx":
            raise BadInput("is the network; give the TOML beside it, which says what its classes are", path)
        self._document = Document.read(self._toml)
        self.spec = self._checked_spec()
        try:
            runtime = import_module("onnxruntime")
        except ModuleNotFoundError:
            raise MissingExtra("perceiver segmentation", "onnx") from None
        self._session = self._opened(runtime)
        self._input, self._channels = self._checked_input()
        self._check_output()

    def __call__(self, image: Image) -> FloatImage:
        """Return the probability of each class, (classes, h, w), h and w those of the network's output."""
        wanted = self.spec.input
        grey = grey_of(image)
        size_px = wanted.width_px, wanted.height_px
        if grey.shape != size_px[::-1]:
            smaller = grey.shape[1] > size_px[0] or grey.shape[0] > size_px[1]
            grey = np.asarray(
                cv2.resize(grey, size_px, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR),
                np.uint8,
            )
        scaled = (grey.astype(np.float32) - np.float32(wanted.mean_grey)) / np.float32(wanted.sd_grey)
        return self._run(scaled)

    def _run(self, scaled: FloatImage) -> FloatImage:
        batch = np.broadcast_to(scaled, (1, self._channels, *scaled.shape))
        values = self._session.run(None, {self._input: np.ascontiguousarray(batch)})[0]
        maps = np.asarray(values[0], np.float32)
        return maps if self.spec.values == "probabilities" else _softmax(maps)

    def _checked_spec(self) -> ModelFile:
        spec = self._document.convert(ModelFile)
        if spec.format != FORMAT:
            raise self._document.error(
                f"format {spec.format} is not known; this version reads {FORMAT}", "format"
            )
        entities = {name: getattr(spec.entity, name) for name in EntityClasses.__struct_fields__}
        named = {name: entity for name, entity in entities.items() if entity is not None}
        if not named:
            raise self._document.error(f"no entity has a class; valid: {', '.join(entities)}", "entity")
        for name, entity in named.items():
            for index in entity.indices if isinstance(entity, SurfaceClass) else (entity.index,):
                if index >= spec.classes:
                    raise self._document.error(
                        f"entity.{name}: class {index} of {spec.classes}; 0 to {spec.classes - 1} are valid",
                        "entity",
                    )
        return spec

    def _opened(self, runtime: Any) -> Any:
        file = self._toml.parent / self.spec.file
        if not file.is_file():
            raise self._document.error(f"no such file: {file}; the network lies beside its TOML", "file")
        options = runtime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.use_deterministic_compute = True
        options.log_severity_level = 4
        try:
            return runtime.InferenceSession(file.read_bytes(), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # ONNX Runtime raises its own kinds for what is torn or too new
            told = " ".join(str(error).split())[:200]
            raise BadInput(f"not a network that ONNX Runtime can run ({told})", file) from None

    def _checked_input(self) -> tuple[str, int]:
        wanted, given = self.spec.input, self._session.get_inputs()
        shape = given[0].shape if len(given) == 1 else []
        valid = [1, (1, 3), wanted.height_px, wanted.width_px]
        fits = len(shape) == 4 and all(
            not isinstance(size, int) or size == fit or (isinstance(fit, tuple) and size in fit)
            for size, fit in zip(shape, valid, strict=True)
        )
        if not fits or given[0].type != "tensor(float)":
            found = f"{len(given)} inputs" if len(given) != 1 else f"{given[0].type} of {_told(shape)}"
            raise self._document.error(
                f"the network takes {found}; tensor(float) of 1 x 1 x {wanted.height_px} x {wanted.width_px} "
                "(or 3 channels) is what [input] says",
                "input",
            )
        return str(given[0].name), shape[1] if isinstance(shape[1], int) else 1

    def _check_output(self) -> None:
        """Run it once on nothing: what shapes a file promises may have no numbers."""
        wanted = self.spec.input
        try:
            maps = self._run(np.zeros((wanted.height_px, wanted.width_px), np.float32))
        except Exception as error:  # whatever ONNX Runtime finds wrong with the network
            told = " ".join(str(error).split())[:200]
            raise BadInput(f"{self.spec.file} does not run on its [input] ({told})", self._toml) from None
        if maps.ndim != 3 or len(maps) != self.spec.classes:
            raise self._document.error(
                f"the network returns {_told((1, *maps.shape))}; 1 x {self.spec.classes} x height x width "
                f"was expected, one map for each of the {self.spec.classes} classes",
                "classes",
            )
        sums = maps.sum(axis=0)
        if not (
            np.isfinite(maps).all() and maps.min() >= -1e-3 and math.isclose(sums.mean(), 1, abs_tol=1e-2)
        ):
            raise self._document.error(
                'the network does not return probabilities that sum to 1; values = "logits" if they are none',
                "values",
            )


def _softmax(logits: FloatImage) -> FloatImage:
    powers = np.exp(logits - logits.max(axis=0))
    return np.asarray(powers / powers.sum(axis=0), np.float32)


def _told(shape: Any) -> str:
    return " x ".join(str(size) for size in shape)
