"""The dictionary of the language holds."""

import pytest
from words import found_in, main


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("The reader is told where it is.", "told"),
        ("what the tracker Tells", "Tells"),
        ("a claim put to the test", "put to the test"),
        ("tip_deviation_mm", "_deviation_"),
        ("how_sure is it", None),
        ("It says how sure it is.", "how sure"),
    ],
)
def test_words_that_are_not_of_the_field_are_found(text, word):
    assert [found for _, found, _ in found_in(text)] == ([word] if word else [])


def test_parts_of_words_and_old_names_are_not():
    assert not found_in("foretold, stellar, forwards")
    assert not found_in('OLD_KEYS = {\n    "told_mm": "reported_mm",\n}')


@pytest.mark.slow  # `make check` finds them too
def test_no_text_of_the_project_has_one(capsys):
    assert main() == 0, capsys.readouterr().out
