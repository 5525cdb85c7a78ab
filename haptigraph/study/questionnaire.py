"""A questionnaire: one TOML file of items in, checked answers out. Knows no page and no store.

Answers are texts, as they are stored and exported; an item says which texts are answers to it.
"""

from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, Struct, field

from haptigraph.errors import BadInput, unknown_name
from haptigraph.toml_document import Document

__all__ = ["Item", "Questionnaire", "load_questionnaire", "questionnaire_names"]

LONGEST_TEXT = 4000
Key = Annotated[str, Meta(pattern="^[A-Za-z0-9][A-Za-z0-9_.-]{0,59}$")]


class Item(Struct, frozen=True, forbid_unknown_fields=True):
    """One question."""

    key: Key
    """Its name in the data; unique in the questionnaire."""
    text: str
    """What is asked."""
    kind: Literal["scale", "choice", "number", "text"]
    """One of the whole numbers from `low` to `high`; one of `choices`; any number between them; words."""
    low: float | None = None
    high: float | None = None
    low_says: str = ""
    """What stands at the low end of a scale."""
    high_says: str = ""
    choices: tuple[str, ...] = ()
    unit: str = ""
    required: bool = True

    def checked(self, answer: str) -> str:
        """Return an answer as it is kept.

        Raises:
            BadInput: If it is none, saying what would be one.
        """
        answer = answer.strip()
        if not self._takes(answer):
            raise BadInput(f"item {self.key!r}: expected {self.valid}, found {answer[:60]!r}")
        return answer

    @property
    def valid(self) -> str:
        """Say what an answer is."""
        if self.kind == "choice":
            return "one of " + ", ".join(self.choices)
        if self.kind == "text":
            return f"1 to {LONGEST_TEXT} characters"
        what = "a whole number" if self.kind == "scale" else "a number"
        bounds = [
            f"{word} {end:g}" for word, end in (("from", self.low), ("to", self.high)) if end is not None
        ]
        return " ".join([what, *bounds])

    def _takes(self, answer: str) -> bool:
        if self.kind == "choice":
            return answer in self.choices
        if self.kind == "text":
            return 0 < len(answer) <= LONGEST_TEXT and "\0" not in answer
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


class Questionnaire(Struct, frozen=True):
    """A checked questionnaire."""

    name: str
    title: str
    source: str
    """Where it is from."""
    intro: str
    """What is said before the items."""
    items: tuple[Item, ...]
    text: str
    """The file as read."""

    def item(self, key: str) -> Item:
        """Return an item.

        Raises:
            BadInput: If there is none of that key.
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
        BadInput: If there is none, or it makes no sense.
    """
    if name.endswith(".toml"):
        return _questionnaire(Document.read(Path(name)))
    if name not in questionnaire_names():
        valid = unknown_name("questionnaire", name, questionnaire_names())
        raise BadInput(f"{valid}, or the path of a .toml file")
    file = resources.files("haptigraph.study").joinpath("questionnaires").joinpath(f"{name}.toml")
    return _questionnaire(Document(file.read_text(encoding="utf-8"), f"questionnaire {name}"))


def _questionnaire(document: Document) -> Questionnaire:
    data = document.convert(_File)
    if not data.items:
        raise document.error("no [[item]] at all; at least one is needed", "questionnaire")
    keys = [item.key for item in data.items]
    for number, item in enumerate(data.items):
        problem = _problem(item, keys[:number])
        if problem:
            raise document.error(problem, f"item[{number}]")
    title = data.questionnaire
    return Questionnaire(title.name, title.title, title.source, title.intro, data.items, document.text)


def _problem(item: Item, earlier: list[str]) -> str:
    if not item.text.strip():
        return f"item {item.key!r} asks nothing; its text is empty"
    if item.key in earlier:
        return f"a second item {item.key!r}; keys must differ"
    if item.kind == "choice" and len(set(item.choices)) < 2:
        return f"item {item.key!r}: a choice needs at least two different choices"
    if item.kind == "scale" and not (item.low is not None and item.high is not None and item.low < item.high):
        return f"item {item.key!r}: a scale needs low and high, low below high"
    return ""
