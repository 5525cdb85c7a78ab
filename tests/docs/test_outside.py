"""Whatever a page would load from another server is found; links that a reader may follow are not refused."""

import sys

import pytest
from outside import main

FAR = "//far.example/x"


@pytest.mark.parametrize(
    "html",
    [
        f'<link rel="stylesheet" href="https:{FAR}.css">',
        f"<script src='https:{FAR}.js'></script>",
        f'<script async\n src="{FAR}.js"></script>',
        f"<script>import('https:{FAR}.js')</script>",
        f'<script type="module">import x from "https:{FAR}.js"</script>',
        f'<script>fetch("https:{FAR}")</script>',
        f"<script>tag.src = 'https:{FAR}.js'</script>",
        f'<script>new WebSocket("wss:{FAR}")</script>',
        f"<style>@import url(https:{FAR}.css);</style>",
        f'<style>@import "https:{FAR}.css";</style>',
        f'<style>@font-face {{ src: local("x"), url("https:{FAR}.woff2") }}</style>',
        f'<p style="background: url(https:{FAR}.png)">',
        f"<img src=https:{FAR}.png>",
        f'<img src="here.png" srcset="here.png 1x, https:{FAR}.png 2x">',
        f'<picture><source srcset="https:{FAR}.webp"></picture>',
        f'<video poster="https:{FAR}.png"></video>',
        f'<iframe src="https:{FAR}"></iframe>',
        f'<object data="https:{FAR}.svg"></object>',
        f'<svg><image xlink:href="https:{FAR}.png"/></svg>',
        f'<meta http-equiv="refresh" content="0; url=https:{FAR}">',
    ],
)
def test_what_a_page_loads_from_elsewhere_is_refused(html, tmp_path, monkeypatch, capsys):
    (tmp_path / "page.html").write_text(f"<html>{html}</html>")
    assert refuses(tmp_path, monkeypatch)
    assert "page.html loads" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("site.css", f'@import "{FAR}.css";'),
        ("site.css", f"a {{ background: url( 'https:{FAR}.png' ) }}"),
        ("site.js", f'fetch("https:{FAR}")'),
        ("site.js", f'request.open("GET", "https:{FAR}")'),
        ("picture.svg", f'<svg><style>@import url("https:{FAR}.css")</style></svg>'),
    ],
)
def test_style_sheets_scripts_and_pictures_are_read(name, text, tmp_path, monkeypatch):
    (tmp_path / name).write_text(text)
    assert refuses(tmp_path, monkeypatch)


def test_links_are_listed(tmp_path, monkeypatch):
    (tmp_path / "page.html").write_text(
        f'<a href="https:{FAR}#part">far</a><a href="near.html">near</a><img src="near.png">'
        f'<svg xmlns="http://www.w3.org/2000/svg"></svg><script>// see https:{FAR}</script>'
    )
    assert not refuses(tmp_path, monkeypatch)
    assert (tmp_path / "external_links.txt").read_text() == f"https:{FAR}  (page.html)\n"


def refuses(site, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["outside.py", str(site)])
    return bool(main())
