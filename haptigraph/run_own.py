"""Check what a perceiver or a source of the user's own returns, and convert its numbers to plain ones.

What ships with haptigraph keeps to the types by itself and is not checked.
"""

import sys
import traceback
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

import msgspec
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.errors import BadInput, HaptigraphError, unknown_name
from haptigraph.geometry import Geometry
from haptigraph.inference.coverage import reported_with
from haptigraph.messages import Capture, Fault, Observation
from haptigraph.sources.wrapper import SourceWrapper
from haptigraph.stages import Perceiver, PerceiverClass, Source

__all__ = ["OwnPerceiver", "OwnSource"]

Message = TypeVar("Message", bound=Struct)
SHAPES = get_args(Geometry)
UNCONVERTED = {"found", "image", "encoded", "depth"}
"""Fields of messages that are checked by themselves, or are arrays."""


class OwnPerceiver:
    """Check and convert the observations of a perceiver of the user's own.

    Args:
        name: "module:Class".
        perceiver: The class.
        anatomy: Of its registration.
        perceive: The perceiver itself.

    Raises:
        BadInput: If `entities_with_sd` names what is not in `entities`.
    """

    def __init__(
        self, name: str, perceiver: PerceiverClass, anatomy: dict[str, Geometry], perceive: Perceiver
    ) -> None:
        self._name, self._anatomy, self._perceiver = f"perceiver {name}", anatomy, perceive
        self._reported = reported_with(perceiver) | anatomy.keys()
        self._file = getattr(sys.modules[type(perceive).__module__], "__file__", None)
        for entity in sorted(set(perceiver.entities_with_sd) - set(perceiver.entities)):
            raise BadInput(
                f"{self._name}: {unknown_name('entity', entity, perceiver.entities)}; entities_with_sd is a "
                "part of entities"
            )

    def __call__(self, capture: Capture) -> Observation:
        """Observe one image; an exception becomes a fault.

        Raises:
            BadInput: If no observation is returned, or one with what is no entity or no finite number.
        """
        try:
            observation = self._perceiver(capture)
        except HaptigraphError:
            raise
        except Exception as error:
            if sys.flags.dev_mode:
                traceback.print_exception(error)
            self._perceiver.reset()
            return Observation(capture.stamp_ns, {}, (Fault("perceiver", self._sentence(error)),))
        if not isinstance(observation, Observation):
            hint = "; is a `return` missing?" if observation is None else ""
            raise BadInput(f"{self._name} returned {_kind(observation)} instead of an Observation{hint}")
        if not isinstance(observation.found, dict):
            raise BadInput(f"{self._name}: found is {_kind(observation.found)}; it must be a dict")
        found = {name: self._shape(name, shape) for name, shape in observation.found.items()}
        return _converted(replace(observation, found=found), self._name)

    def reset(self) -> None:
        """Forget earlier images."""
        self._perceiver.reset()

    def _shape(self, name: str, shape: Geometry) -> Geometry:
        if shape is self._anatomy.get(name):
            return shape
        if name not in self._reported:
            raise BadInput(f"{self._name} reports an {unknown_name('entity', name, self._reported)}")
        if not isinstance(shape, SHAPES):
            valid = ", ".join(kind.__name__ for kind in SHAPES)
            raise BadInput(f"{self._name}: {name} is {_kind(shape)}; it must be one of {valid}")
        plain: Geometry = _plain(shape, type(shape), f"{self._name}: {name}")
        return plain

    def _sentence(self, error: Exception) -> str:
        """Return what was raised, and from which line of the class's module."""
        frames = traceback.extract_tb(error.__traceback__)
        frame = next((each for each in reversed(frames) if each.filename == self._file), frames[-1])
        raised = f"{type(error).__name__}: {error} ({Path(frame.filename).name}, line {frame.lineno})"
        name = self._name.removeprefix("perceiver ")
        return f"{name} raised {raised}; `python -X dev -m haptigraph` prints the traceback"


class OwnSource(SourceWrapper):
    """Check and convert the captures of a source of the user's own.

    Args:
        name: "module:Class".
        source: The source itself.
        is_live: What its class says.

    Raises:
        BadInput: If the source says something else than its class.
    """

    def __init__(self, name: str, source: Source, *, is_live: bool) -> None:
        super().__init__(source)
        self._name = f"source {name}"
        if source.is_live != is_live:
            raise BadInput(
                f"{self._name}: is_live is {source.is_live}; set it on the class, not on the object"
            )

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next capture.

        Raises:
            BadInput: If something else is returned, or a capture with what is no image or no finite number.
        """
        capture = self._source.read(timeout_s)
        if capture is None:
            return None
        if not isinstance(capture, Capture):
            raise BadInput(f"{self._name} returned {_kind(capture)} instead of a Capture or None")
        image = capture.image
        if image is not None and not (
            isinstance(image, np.ndarray) and image.dtype == np.uint8 and image.ndim in (2, 3)
        ):
            found = f"{image.dtype} {image.shape}" if isinstance(image, np.ndarray) else _kind(image)
            raise BadInput(f"{self._name}: image is {found}; it must be uint8, (h, w, 3) or (h, w)")
        return _converted(capture, self._name)


def _converted(message: Message, name: str) -> Message:
    """Return a message whose fields have plain numbers of the annotated types."""
    changed = {
        field: _plain(getattr(message, field), kind, f"{name}: {field}")
        for field, kind in _kinds(type(message)).items()
    }
    return replace(message, **changed)


@cache
def _kinds(message: type[Struct]) -> dict[str, Any]:
    return {name: kind for name, kind in get_type_hints(message).items() if name not in UNCONVERTED}


def _plain(value: Any, kind: Any, what: str) -> Any:
    """Return a value with plain numbers, as a recording keeps it.

    Raises:
        BadInput: If it is not of the kind, or a number is not finite.
    """
    try:
        return msgspec.json.decode(msgspec.json.encode(value, enc_hook=_listed), type=kind)
    except (msgspec.ValidationError, TypeError) as error:
        problem, _, place = str(error).partition(" - at `$")
        problem = problem.replace("`null`", "None, nan or inf")
        raise BadInput(f"{what}{place.rstrip('`')}: {problem}") from None


def _listed(value: Any) -> Any:
    """Return a NumPy number or an array, also one of PyTorch, as plain numbers."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"found {_kind(value)}")


def _kind(value: object) -> str:
    return "None" if value is None else f"a {type(value).__name__}"
