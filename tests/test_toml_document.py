"""Keys by their names in earlier versions: read, with one warning each, wherever they are."""

import warnings
from typing import ClassVar

import pytest
from helpers import call
from msgspec import Struct

from haptigraph.config import HapticsConfig, load_config
from haptigraph.errors import BadInput, RenamedKey
from haptigraph.toml_document import Document


class Inner(Struct, frozen=True, forbid_unknown_fields=True):
    OLD_KEYS: ClassVar[dict[str, str]] = {"deviation_mm": "sd_mm"}
    sd_mm: float = 0.0


class Outer(Struct, frozen=True, forbid_unknown_fields=True):
    OLD_KEYS: ClassVar[dict[str, str]] = {"glare": "highlights", "spots": "items"}
    highlights: Inner = Inner()
    items: tuple[Inner, ...] = ()
    maybe: Inner | None = None


def warnings_of(text):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = Document(text, "a.toml").convert(Outer)
    assert all(warning.category is RenamedKey for warning in caught)
    return result, [str(warning.message) for warning in caught]


def test_an_old_key_in_a_nested_table_is_read():
    result, messages = warnings_of("[highlights]\n\ndeviation_mm = 2.0\n")
    assert result == Outer(highlights=Inner(2.0))
    assert messages == ["a.toml, line 3: key 'deviation_mm' is now called 'sd_mm'"]


def test_an_old_table_name_with_an_old_key_is_read():
    result, messages = warnings_of("[glare]\ndeviation_mm = 2.0\n")
    assert result == Outer(highlights=Inner(2.0))
    assert messages == [
        "a.toml, line 1: key 'glare' is now called 'highlights'",
        "a.toml, line 2: key 'deviation_mm' is now called 'sd_mm'",
    ]


def test_old_keys_in_arrays_of_tables_are_read():
    result, messages = warnings_of("[[spots]]\nsd_mm = 1.0\n[[spots]]\ndeviation_mm = 2.0\n")
    assert result == Outer(items=(Inner(1.0), Inner(2.0)))
    assert messages == [
        "a.toml, line 1: key 'spots' is now called 'items'",
        "a.toml, line 4: key 'deviation_mm' is now called 'sd_mm'",
    ]


def test_an_old_key_in_an_optional_table_is_read():
    result, messages = warnings_of("maybe = { deviation_mm = 3.0 }\n")
    assert result == Outer(maybe=Inner(3.0))
    assert len(messages) == 1


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (
            "[highlights]\nsd_mm = 1.0\ndeviation_mm = 2.0\n",
            "line 3: both 'deviation_mm' and 'sd_mm', which is its new name; keep 'sd_mm'",
        ),
        (
            "[glare]\n[highlights]\n",
            "line 1: both 'glare' and 'highlights', which is its new name; keep 'highlights'",
        ),
    ],
)
def test_an_old_and_a_new_key_together_are_an_error(text, problem):
    with pytest.raises(BadInput) as raised:
        Document(text, "a.toml").convert(Outer)
    assert str(raised.value) == f"a.toml, {problem}"


def test_a_wrong_value_of_an_old_key_is_reported_by_its_new_name():
    with pytest.warns(RenamedKey), pytest.raises(BadInput, match=r"highlights\.sd_mm: expected float"):
        Document("[glare]\ndeviation_mm = 'x'\n", "a.toml").convert(Outer)


LISTS = """title = "x"
names = [  # of two
  "a", "b",
  "c]",

  "d",  # ]
]
one_line = ["a", "b"]
inner.names = ["a"]
"""


@pytest.mark.parametrize(
    ("path", "line"),
    [
        *(("names", 2), ("names[0]", 3), ("names[1]", 3), ("names[2]", 4), ("names[3]", 6)),
        *(("one_line[1]", 8), ("one_line[7]", 8), ("inner.names[0]", 9), ("title[3]", 1)),
    ],
)
def test_an_error_in_a_list_is_reported_at_the_line_of_its_item(path, line):
    assert Document(LISTS, "a.toml").error("wrong", path).place == f"line {line}"


@pytest.fixture
def old_setting(monkeypatch):
    """As if haptics.deadman_ms had been named haptics.deadman in an earlier version."""
    monkeypatch.setattr(HapticsConfig, "OLD_KEYS", {"deadman": "deadman_ms"}, raising=False)


def test_set_accepts_an_old_key_and_overrides_the_file(old_setting, tmp_path):
    (tmp_path / "lab.toml").write_text("[haptics]\ndeadman_ms = 100\n")
    with pytest.warns(RenamedKey, match="--set: key 'deadman' is now called 'deadman_ms'"):
        assert load_config(tmp_path / "lab.toml", ("haptics.deadman=120",)).haptics.deadman_ms == 120
    (tmp_path / "lab.toml").write_text("[haptics]\ndeadman = 100\n")
    with pytest.warns(RenamedKey, match=r"lab\.toml, line 2: key 'deadman' is now called 'deadman_ms'"):
        assert load_config(tmp_path / "lab.toml", ("haptics.deadman_ms=120",)).haptics.deadman_ms == 120


def test_the_command_line_prints_one_sentence_for_an_old_key(old_setting, quick_uri, tmp_path):
    file = tmp_path / "lab.toml"
    file.write_text("[haptics]\ndeadman = 100\n")
    result = call("run", quick_uri, "--fast", "--config", file)
    assert result.exit_code == 0
    about_keys = [line for line in result.stderr.splitlines() if "deadman" in line]
    assert about_keys == [f"haptigraph: {file}, line 2: key 'deadman' is now called 'deadman_ms'"]
    result = call("run", quick_uri, "--fast", "--set", "haptics.deadman=100")
    about_keys = [line for line in result.stderr.splitlines() if "deadman" in line]
    assert about_keys == ["haptigraph: --set: key 'deadman' is now called 'deadman_ms'"]
