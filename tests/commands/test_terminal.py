"""When `live` opens the browser, and what it prints."""

import sys
import threading
import webbrowser

import pytest

from haptigraph.commands import terminal


class Page:
    address = "http://127.0.0.1:1/"
    address_lines = ("haptigraph: the page is at http://127.0.0.1:1/",)
    qr_codes = (("watch", "CODE 1"), ("steer", "CODE 2"))


@pytest.fixture
def shown(monkeypatch, capsys):
    """Show the page under an environment; return what was printed, and which addresses were opened."""
    opened = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr(sys, "platform", "linux")

    def show(*, opens=True, is_terminal=True, **environment):
        for name in (*terminal.SSH, *terminal.DISPLAYS):
            monkeypatch.delenv(name, raising=False)
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        monkeypatch.setattr(sys.stderr, "isatty", lambda: is_terminal, raising=False)
        opened.clear()
        terminal.show_page(Page(), opens=opens)
        for thread in threading.enumerate():
            if thread.name == terminal.OPENER:
                thread.join(5)
        return capsys.readouterr().err, list(opened)

    return show


def test_it_opens_where_a_person_sits_at_the_screen(shown):
    text, opened = shown(DISPLAY=":0")
    assert opened == [Page.address]
    assert text.startswith(Page.address_lines[0])


@pytest.mark.parametrize(
    "situation",
    [
        {"opens": False, "DISPLAY": ":0"},
        {"is_terminal": False, "DISPLAY": ":0"},
        {"DISPLAY": ":0", "SSH_CONNECTION": "192.0.2.1 22"},
        {},
    ],
)
def test_it_does_not_open_elsewhere(shown, situation):
    assert shown(**situation)[1] == []


def test_qr_codes_are_for_terminals(shown):
    text, _ = shown()
    assert "scan to watch\nCODE 1" in text and "scan to steer\nCODE 2" in text
    assert "CODE" not in shown(is_terminal=False)[0]


def test_without_a_terminal_progress_is_a_line_every_ten_seconds(monkeypatch, capsys):
    now_s = iter((0.0, 5.0, 11.0, 12.0, 21.5))
    monkeypatch.setattr(terminal.time, "monotonic", lambda: next(now_s))
    with terminal.progress_bar() as progress:
        for scene in range(5):
            progress("playing scenes", scene, 17)
    assert capsys.readouterr().err == "playing scenes: 2 of 17\nplaying scenes: 4 of 17\n"
