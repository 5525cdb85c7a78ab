import pytest

from haptigraph.errors import MAX_LENGTH, BadInput


@pytest.mark.parametrize("length", [10, MAX_LENGTH, MAX_LENGTH + 1, 100_000])
def test_a_message_is_bounded_and_keeps_its_beginning_and_end(length):
    problem = "found ".ljust(length - 5, "x") + "valid"
    text = str(BadInput(problem, "a.toml", "line 2"))
    assert text.startswith("a.toml, line 2: found x" if length > 12 else "a.toml, line 2: found")
    assert text.endswith("valid")
    assert len(text) <= MAX_LENGTH + 25
    assert (text == f"a.toml, line 2: {problem}") is (length <= MAX_LENGTH)
