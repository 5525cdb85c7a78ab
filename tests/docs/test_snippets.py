"""A page whose command or program does not do what it shows fails."""

import pytest

pytest.importorskip("sybil", reason="needs the packages of `make docs`")

import snippets
from snippets import parse, setup, teardown
from sybil import Document
from sybil.example import SybilFailure


def run(text, folder):
    document = Document(text, str(folder / "page.md"))
    setup(document.namespace, folder)
    for region in parse(document):
        document.add(region)
    try:
        for example in document.examples():
            example.evaluate()
    finally:
        teardown(document.namespace)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("```console\n$ echo right\nwrong\n```\n", "printed:\nright"),
        ("```console\n$ false\n```\n", "ended with 1, expected 0"),
        ("<!-- exit 2 -->\n\n```console\n$ true\n```\n", "ended with 0, expected 2"),
        ("<!-- until ready -->\n\n```console\n$ echo never\n```\n", "without printing 'ready'"),
        ("<!-- not run: slow -->\n\n```console\n$ haptigraph run --fats\n```\n", "no option --fats"),
        ("<!-- not run: slow -->\n\n```console\n$ haptigraph rnu\n```\n", "no command 'rnu'"),
        ("```console\nhaptigraph demo\n```\n", "begins with `$ `"),
        ("```\nhaptigraph demo\n```\n", "say console, python"),
        ("```bash\nhaptigraph demo\n```\n", "say console, python"),
        ("```toml\n[source\n```\n", "Expected"),
        ("```python\nassert 1 == 2\n```\n", ""),
        (
            "<!-- file a.toml -->\n\n```toml\na = 1\n```\n\n<!-- change a.toml -->\n\n```diff\n-b = 1\n+b = 2\n```\n",
            "does not contain",
        ),
    ],
)
def test_what_is_wrong_fails(text, problem, tmp_path):
    with pytest.raises((SybilFailure, AssertionError, ValueError)) as failed:
        run(text, tmp_path)
    assert problem in str(failed.value)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (
            "<!-- until ready -->\n\n```console\n$ echo never; sleep 900\n```\n",
            "without printing 'ready':\nnever",
        ),
        (
            "<!-- until ready -->\n\n```console\n$ trap '' INT; echo ready; sleep 900\n```\n",
            "without ending:\nready",
        ),
        ("```console\n$ echo begun; sleep 900 &\n```\n", "without ending:\nbegun"),
        ("```console\n$ echo begun; sleep 900\n```\n", "without ending:\nbegun"),
    ],
)
def test_a_command_that_goes_on_and_on_is_killed(text, problem, tmp_path, monkeypatch):
    monkeypatch.setattr(snippets, "TIMEOUT_S", 1)
    with pytest.raises(SybilFailure) as failed:
        run(text, tmp_path)
    assert "was killed after 1 s " in str(failed.value)
    assert problem in str(failed.value)


def test_a_page_is_one_session(tmp_path):
    run(
        """
<!-- file part/a.toml -->

```toml
a = 1
```

<!-- change part/a.toml -->

```diff
-a = 1
+a = 2
```

```console
$ cd part
$ cat a.toml
a = ...
```

```python
from pathlib import Path

text = Path("part/a.toml").read_text()
```

```python
assert text == "a = 2\\n"
```

```text
not run
```
""",
        tmp_path,
    )
