"""The items of a study's frozen questionnaires, with wording and anchors, as a table of its export."""

import tomllib
from collections.abc import Iterator, Mapping
from typing import Any, Literal

from haptigraph.study.frozen.parts import frozen_questionnaires
from haptigraph.study.questionnaire import Item, Questionnaire

__all__ = ["item_rows", "typed_answer", "value_kind"]


def item_rows(study: str, parts: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    """Yield a row for every item, in the order of the protocol.

    Args:
        study: The study's name.
        parts: The frozen texts of its protocol.
    """
    times = {
        f"questionnaire {table['file']}": table["when"]
        for table in tomllib.loads(parts["study.toml"]).get("questionnaire", [])
    }
    for part, each in frozen_questionnaires(parts).items():
        for number, item in enumerate(each.items, 1):
            yield {"study": study, "when": times.get(part), "number": number, **_row(each, item)}


def value_kind(item: Item | None) -> Literal["text", "integer", "number"]:
    """Return the kind of a column with the answers to an item; text if the item is not known."""
    if item is None or item.kind in ("choice", "text"):
        return "text"
    return "integer" if item.kind == "scale" else "number"


def typed_answer(item: Item | None, answer: str) -> str | int | float:
    """Return an answer as a value of its column."""
    kind = value_kind(item)
    return answer if kind == "text" else int(answer) if kind == "integer" else float(answer)


def _row(questionnaire: Questionnaire, item: Item) -> dict[str, Any]:
    is_turned = questionnaire.score is not None and item.key in questionnaire.score.reversed
    return {
        "questionnaire": questionnaire.name,
        "title": questionnaire.title,
        "source": questionnaire.source or None,
        "item": item.key,
        "wording": item.text,
        "kind": item.kind,
        "low": item.low,
        "low_label": item.low_label or None,
        "high": item.high,
        "high_label": item.high_label or None,
        "choices": " | ".join(item.choices) or None,
        "unit": item.unit or None,
        "required": int(item.required),
        "reversed": int(is_turned),
    }
