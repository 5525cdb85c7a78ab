"""Score the questionnaires of a study: answers by participant and condition into one table for each."""

from collections.abc import Mapping

import pandas as pd
from msgspec.structs import replace

from haptigraph.analysis.study.quantities import QUANTITIES, Quantity
from haptigraph.errors import BadInput
from haptigraph.study.questionnaire import Questionnaire, load_questionnaire, questionnaire_names

__all__ = ["score_quantities", "score_questionnaire", "scored_questionnaires", "unscored_names"]


def scored_questionnaires(answers: pd.DataFrame, frozen: Mapping[str, Questionnaire]) -> list[Questionnaire]:
    """Return the questionnaires in the answers that have a score.

    One that was frozen without a score is scored as the one of the same name and items that ships.

    Args:
        answers: The table of answers.
        frozen: The study's questionnaires by name; none where the export has no protocol.
    """
    names = sorted(set(answers["questionnaire"].dropna().astype(str).str.lower()))
    shipped = {name: load_questionnaire(name) for name in names if name in questionnaire_names()}
    frozen = {name.lower(): each for name, each in frozen.items()}
    found = {name: _with_score(frozen.get(name), shipped.get(name)) for name in names}
    return [each for each in found.values() if each is not None and each.score is not None]


def score_questionnaire(answers: pd.DataFrame, questionnaire: Questionnaire) -> pd.DataFrame:
    """Score every sheet of one questionnaire; one with a missing answer has no score (NaN).

    Args:
        answers: The table of answers.
        questionnaire: With a score.

    Returns:
        participant, condition, position (NaN if unknown), answered (items), and a column for each score.

    Raises:
        BadInput: If an item or an answer is invalid.
    """
    name, rows = questionnaire.name.lower(), []
    answers = answers[answers["questionnaire"].astype(str).str.lower() == name]
    for (participant, condition), sheet in answers.groupby(["participant", "condition"], sort=True):
        given = _given(sheet, questionnaire, f"{questionnaire.name} of {participant}, {condition}")
        position = sheet["position"].iloc[0] if "position" in sheet else float("nan")
        row = {"participant": participant, "condition": condition, "position": position}
        rows.append({**row, "answered": len(given), **questionnaire.scores(given)})
    columns = [scale.name for scale in questionnaire.scales]
    return pd.DataFrame(rows, columns=["participant", "condition", "position", "answered", *columns])


def unscored_names(answers: pd.DataFrame, scored: list[Questionnaire]) -> list[str]:
    """Return the names of the questionnaires that were answered after conditions and have no score."""
    about = answers.dropna(subset=["condition", "questionnaire"])
    names = {each.name.lower() for each in scored}
    return sorted({str(name) for name in about["questionnaire"] if str(name).lower() not in names})


def score_quantities(questionnaires: list[Questionnaire]) -> list[Quantity]:
    """Return the scores as outcomes, except those that are outcomes of every study (SUS)."""
    standing = {each.name for each in QUANTITIES}
    return [
        Quantity(scale.name, scale.title, f"{scale.low:g}-{scale.high:g}", "questionnaires")
        for each in questionnaires
        for scale in each.scales
        if scale.name not in standing
    ]


def _with_score(frozen: Questionnaire | None, shipped: Questionnaire | None) -> Questionnaire | None:
    if frozen is None or frozen.score is not None or shipped is None:
        return frozen or shipped
    items = [[(item.key, item.low, item.high) for item in each.items] for each in (frozen, shipped)]
    return replace(frozen, score=shipped.score) if items[0] == items[1] else frozen


def _given(sheet: pd.DataFrame, questionnaire: Questionnaire, place: str) -> dict[str, float]:
    """Return the numeric answers of one sheet by item."""
    given: dict[str, float] = {}
    keys = [_key(str(name).strip(), questionnaire) for name in sheet["item"]]
    if len(set(keys)) < len(keys):
        raise BadInput("an item was answered twice", place=place)
    for key, answer in zip(keys, sheet["answer"], strict=True):
        try:
            item = questionnaire.item(key)
            if pd.notna(answer) and item.kind in ("scale", "number"):
                given[key] = float(item.checked(str(answer).removesuffix(".0")))
        except BadInput as error:
            raise BadInput(error.problem, place=place) from None
    return given


def _key(name: str, questionnaire: Questionnaire) -> str:
    """Return the key of an item, which other programs name `sus_3` or `q3` instead of `3`."""
    keys = [item.key for item in questionnaire.items]
    bare = name.lower().removeprefix(questionnaire.name.lower()).lstrip("_ ")
    return next((key for key in (name, bare, bare.removeprefix("q").lstrip("_ ")) if key in keys), name)
