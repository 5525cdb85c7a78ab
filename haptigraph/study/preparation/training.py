"""The training of a protocol: once or before each condition, for a number of trials or up to a criterion."""

from collections.abc import Sequence
from typing import Annotated, Literal

from msgspec import Meta, Struct

from haptigraph.errors import unknown_name
from haptigraph.toml_document import Document

__all__ = ["Training", "check_training"]


class Training(Struct, frozen=True, forbid_unknown_fields=True):
    """The [training] table; without it there is no training."""

    before: Literal["study", "condition"]
    """Once before the first condition, or before and under each condition."""
    condition: str = ""
    """The condition of the training that takes place once."""
    trials: Annotated[int, Meta(ge=1, le=1000)] = 1
    timeout_s: Annotated[float, Meta(gt=0, le=36_000)] = 300.0
    free: bool = True
    """Whether a trial continues after Target Hit."""
    until_hits: Annotated[int, Meta(ge=0, le=1000)] = 0
    """Training ends after so many hits in a row, at the latest after `trials`; 0: always after `trials`."""


def check_training(document: Document, training: Training, design: str, conditions: Sequence[str]) -> None:
    """Check the table of a protocol.

    Args:
        document: The protocol, for errors.
        training: The table.
        design: Of the study.
        conditions: Their names.

    Raises:
        BadInput: If it cannot be used, with what would be valid.
    """
    if training.before == "condition" and training.condition:
        raise document.error(
            "training before each condition uses that condition; remove the key", "training.condition"
        )
    if training.before == "study" and design == "between":
        if training.condition:
            raise document.error(
                "with design between, training uses the participant's own condition; remove the key",
                "training.condition",
            )
    elif training.before == "study" and training.condition not in conditions:
        raise document.error(unknown_name("condition", training.condition, conditions), "training.condition")
    if training.until_hits and training.free:
        problem = "until_hits needs free = false: a hit does not end a free trial"
        raise document.error(problem, "training.until_hits")
    if training.until_hits > training.trials:
        problem = f"until_hits: {training.until_hits} hits need as many trials; found {training.trials}"
        raise document.error(problem, "training.until_hits")
