"""Refuse words that are not of the field, in the package, its pages, docs and examples: `make check`.

Each word here has no other sense in this project; what to say instead stands beside it.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
SUFFIXES = {".py", ".c", ".h", ".js", ".html", ".css", ".toml", ".md", ".rst", ".ipynb"}
PLACES = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "haptigraph", "docs", "examples")
INSTEAD = {
    r"(un)?told|tells|telling": "report, indicate, notify, distinguish",
    r"spoil(s|t|ed)?": "degrade",
    r"glimpses?": "candidate",
    r"wish(es|ed)?": "override, request",
    r"stilled|stills": "silence, stop the vibration",
    r"ward(s|ens?|ed)?": "watchdog",
    r"close-?ups?": "tip patch, sub-pixel tip",
    r"glints?": "specular highlight",
    r"empty[ _]eyes?": "background, reference image without instrument",
    r"la(y|id|ying)[ _]straight": "rectify",
    r"mouths?": "port opening",
    r"sure(r|st)": "more certain, most certain",
    r"likeliest": "most probable",
    r"no news|handed in": "no data received, submit",
    r"take in|looks? again": "process, enrol, refresh",
    r"put to the test": "exercised",
    r"how sure": "confidence, uncertainty",
    r"difficult(y|ies)": "nuisance condition, artefact",
    r"surprises?": "innovation",
    r"is no number": "is not a number, is not a valid step number",
}
"""By what they are replaced: whole words, also between the underscores of names."""
PARTS = {r"_deviation_": "_sd_"}
ANY = re.compile("|".join([*INSTEAD, *PARTS]), re.IGNORECASE)
"""Rules most lines out at once."""
OLD_NAMES = re.compile(r"OLD_[A-Z]+|RENAMED")
"""Where names of earlier versions are read, these words are data: in the statement that begins so."""
EXEMPT = (
    *("docs/decisions/0", "docs/reference/upgrading.md", "docs/words.py"),
    *("docs/gallery/", "docs/notebooks/"),  # copies, made by Sphinx
    "haptigraph/study/questionnaires/",  # a changed text would change studies that were frozen with it
)


def found_in(text: str) -> list[tuple[int, str, str]]:
    """Return line, word and what to say instead."""
    found = []
    is_old = False
    for number, line in enumerate(text.splitlines(), 1):
        is_old = bool(OLD_NAMES.search(line)) or (is_old and not re.match(r"\s*[)}\]]|\s*$", line))
        if is_old or not ANY.search(line):
            continue
        for pattern, instead in INSTEAD.items():
            found += [
                (number, match[0].strip("_"), instead)
                for match in re.finditer(rf"(?i)(?<![a-z])({pattern})(?![a-z])", line)
            ]
        found += [
            (number, match[0], instead)
            for part, instead in PARTS.items()
            for match in re.finditer(part, line)
        ]
    return found


def main() -> int:
    """Print what is refused."""
    places = [ROOT / place for place in PLACES]
    refused = 0
    for path in (*places, *(path for place in places for path in place.rglob("*"))):
        name = path.relative_to(ROOT).as_posix()
        if path.suffix in SUFFIXES and not name.startswith(EXEMPT):
            for line, word, instead in found_in(path.read_text(encoding="utf-8")):
                print(f"{name}:{line}: {word!r}; say: {instead}")
                refused += 1
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main())
