"""A questionnaire: a TOML file with items that validate their answers.

Answers are strings, as stored and exported; each item defines which strings are valid.
"""

from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, Struct, field

from haptigraph.errors import BadInput, unknown_name
from haptigraph.study.questionnaires.scoring import Bounds, Scale, Scoring, scales_of, score, scoring_problem
from haptigraph.toml_document import Document

__all__ = ["Item", "Questionnaire", "load_questionnaire", "parse_questionnaire", "questionnaire_names"]

MAX_TEXT_LENGTH = 4000
Key = Annotated[str, Meta(pattern="^[A-Za-z0-9][A-Za-z0-9_.-]{0,59}$")]


class Item(Struct, frozen=True, forbid_unknown_fields=True):
    """One questionnaire item."""

    OLD_KEYS: ClassVar[dict[str, str]] = {"low_says": "low_label", "high_says": "high_label"}

    key: Key
    """Name in the data; unique in the questionnaire."""
    text: str
    """The question or statement."""
    kind: Literal["scale", "choice", "number", "text"]
    """An integer from `low` to `high`; one of `choices`; any number between `low` and `high`; free text."""
    low: float | None = None
    high: float | None = None
    low_label: str = ""
    """Label of the low end of a scale."""
    high_label: str = ""
    choices: tuple[str, ...] = ()
    unit: str = ""
    required: bool = True

    def checked(self, answer: str) -> str:
        """Return an answer in the stored form.

        Raises:
            BadInput: If it is invalid, with what would be valid.
        """
        answer = answer.strip()
        if not self._is_valid(answer):
            raise BadInput(f"item {self.key!r}: expected {self.valid}, found {answer[:60]!r}")
        return answer

    @property
    def valid(self) -> str:
        """Description of the valid answers."""
        if self.kind == "choice":
            return "one of " + ", ".join(self.choices)
        if self.kind == "text":
            return f"1 to {MAX_TEXT_LENGTH} characters"
        what = "a whole number" if self.kind == "scale" else "a number"
        bounds = [
            f"{word} {end:g}" for word, end in (("from", self.low), ("to", self.high)) if end is not None
        ]
        return " ".join([what, *bounds])

    def _is_valid(self, answer: str) -> bool:
        if self.kind == "choice":
            return answer in self.choices
        if self.kind == "text":
            return 0 < len(answer) <= MAX_TEXT_LENGTH and "\0" not in answer
        try:
            number = int(answer) if self.kind == "scale" else float(answer)
        except ValueError:
            return False
        low, high = self.low, self.high
        return (low is None or number >= low) and (high is None or number <= high) and abs(number) < 1e12


class _Title(Struct, frozen=True, forbid_unknown_fields=True):
    name: Key
    title: str
    source: str = ""
    intro: str = ""


class _File(Struct, frozen=True, forbid_unknown_fields=True):
    questionnaire: _Title
    items: tuple[Item, ...] = field(name="item")
    score: Scoring | None = None


class Questionnaire(Struct, frozen=True):
    """A checked questionnaire."""

    name: str
    title: str
    source: str
    """Where it was published."""
    intro: str
    """Shown before the items."""
    items: tuple[Item, ...]
    text: str
    """The file as read."""
    score: Scoring | None = None

    @property
    def scales(self) -> list[Scale]:
        """Its scores: the total, then subscales; none without [score]."""
        return scales_of(self.score, self.name, self.title, _bounds(self.items)) if self.score else []

    def scores(self, answers: Mapping[str, float]) -> dict[str, float]:
        """Return the scores by the names of `scales`, NaN where an answer is missing."""
        bounds = _bounds(self.items)
        return {each.name: score(self.score, each, answers, bounds) for each in self.scales if self.score}

    def item(self, key: str) -> Item:
        """Return an item.

        Raises:
            BadInput: If there is no item with that key.
        """
        for item in self.items:
            if item.key == key:
                return item
        raise BadInput(
            f"questionnaire {self.name}: " + unknown_name("item", key, [i.key for i in self.items])
        )


def questionnaire_names() -> list[str]:
    """Return the names of the questionnaires that ship with haptigraph."""
    files = resources.files("haptigraph.study").joinpath("questionnaires").iterdir()
    return sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml"))


def load_questionnaire(name: str) -> Questionnaire:
    """Load a questionnaire by its name, or from a path that ends in .toml.

    Raises:
        BadInput: If there is no such questionnaire, or it is invalid.
    """
    if name.endswith(".toml"):
        return _questionnaire(Document.read(Path(name)))
    if name not in questionnaire_names():
        valid = unknown_name("questionnaire", name, questionnaire_names())
        raise BadInput(f"{valid}, or the path of a .toml file")
    file = resources.files("haptigraph.study").joinpath("questionnaires").joinpath(f"{name}.toml")
    return parse_questionnaire(file.read_text(encoding="utf-8"), f"questionnaire {name}")


def parse_questionnaire(text: str, file: str) -> Questionnaire:
    """Read and check a questionnaire from its text; `file` names it in errors."""
    return _questionnaire(Document(text, file))


def _questionnaire(document: Document) -> Questionnaire:
    data = document.convert(_File)
    if not data.items:
        raise document.error("no [[item]]; at least one is required", "questionnaire")
    keys = [item.key for item in data.items]
    for number, item in enumerate(data.items):
        problem = _problem(item, keys[:number])
        if problem:
            raise document.error(problem, f"item[{number}]")
    wrong = scoring_problem(data.score, _bounds(data.items)) if data.score else None
    if wrong:
        raise document.error(wrong[0], f"score.{wrong[1]}")
    title = data.questionnaire
    head = (title.name, title.title, title.source, title.intro)
    return Questionnaire(*head, data.items, document.text, data.score)


def _bounds(items: Iterable[Item]) -> Bounds:
    return {
        item.key: (item.low, item.high)
        for item in items
        if item.kind in ("scale", "number") and item.low is not None and item.high is not None
    }


def _problem(item: Item, earlier: list[str]) -> str:
    if not item.text.strip():
        return f"item {item.key!r}: the text is empty; write the question or statement"
    if item.key in earlier:
        return f"a second item {item.key!r}; keys must differ"
    if item.kind == "choice" and len(set(item.choices)) < 2:
        return f"item {item.key!r}: a choice needs at least two different choices"
    if item.kind == "scale" and not (item.low is not None and item.high is not None and item.low < item.high):
        return f"item {item.key!r}: a scale needs low and high, low below high"
    return ""
