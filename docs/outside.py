"""Refuse a built site that loads anything from elsewhere; list the links that a reader may follow.

python docs/outside.py build/docs [--browser]

With --browser, Chromium visits pages of every section, which may ask nothing but the site, and searches it
without any server.
"""

import re
import shutil
import sys
from collections import defaultdict
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

URL = r"(?P<url>(?:https?:|wss?:)?//[^\"'`)\s]+)"
REMOTE = re.compile(r"\s*(?:https?:|wss?:)?//")
STYLED = re.compile(rf"""(?:url\(\s*|@import\s+)["']?{URL}""")
SCRIPTED = re.compile(
    rf"""(?:\b(?:fetch|import|importScripts|WebSocket|EventSource|Worker|open)\(\s*(?:["']\w+["']\s*,\s*)?"""
    rf"""|\b(?:import|from)\s*|\.(?:src|href)\s*=\s*)["'`]{URL}"""
)
LOADING = {"src", "srcset", "imagesrcset", "poster", "data", "background"}
"""Attributes whose address a browser fetches without being asked, whatever their element."""
HREF_LOADS = {"link", "image", "use", "feimage"}
VISITED = 15
SEARCHED = "theta"


class Page(HTMLParser):
    """What one page loads and links."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.linked: list[str] = []
        self._in = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect addresses in attributes."""
        self._in = tag
        for name, value in attrs:
            if not value:
                continue
            if name == "style":
                self.loaded += in_text(STYLED, value)
            elif name == "content" and tag == "meta":
                self.loaded += re.findall(r"url=(\S+//\S+)", value)
            elif name in LOADING or (name in ("href", "xlink:href") and tag in HREF_LOADS):
                parts = value.split(",") if name.endswith("srcset") else [value]
                self.loaded += [part.strip() for part in parts if REMOTE.match(part)]
            elif name == "href" and REMOTE.match(value):
                self.linked.append(value.partition("#")[0])

    handle_startendtag = handle_starttag

    def handle_endtag(self, tag: str) -> None:
        """Leave styles and scripts."""
        self._in = ""

    def handle_data(self, data: str) -> None:
        """Collect addresses in styles and scripts."""
        if self._in in ("style", "script"):
            self.loaded += in_text(STYLED if self._in == "style" else SCRIPTED, data)


def in_text(pattern: re.Pattern[str], text: str) -> list[str]:
    """Return the addresses that a pattern finds."""
    return [found["url"] for found in pattern.finditer(text)]


def read(path: Path) -> tuple[list[str], list[str]]:
    """Return what a file of the site loads from elsewhere, and the links in it."""
    text = path.read_text(encoding="utf-8")
    if path.suffix in (".html", ".svg"):
        page = Page(text)
        return page.loaded, page.linked
    return in_text(STYLED if path.suffix == ".css" else SCRIPTED, text), []


def visit(site: Path) -> Iterator[str]:
    """Visit pages in Chromium, and search; yield what is wrong."""
    from playwright.sync_api import TimeoutError as TooLate  # noqa: PLC0415 - readers do not need it
    from playwright.sync_api import sync_playwright  # noqa: PLC0415

    pages = sorted(site.rglob("*.html"))
    chosen = [*pages[:: max(1, len(pages) // VISITED)], site / "index.html", site / "search.html"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page()
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.route(re.compile("^(?!file:|data:|blob:)"), lambda route: route.abort())
        for path in chosen:
            asked.clear()
            page.goto(path.as_uri(), wait_until="networkidle")
            yield from (f"{path.relative_to(site)} asks {url}" for url in asked if REMOTE.match(url))
        page.goto(f"{(site / 'search.html').as_uri()}?q={SEARCHED}")
        try:
            page.wait_for_selector("#search-results li a", timeout=20_000)
        except TooLate:
            yield f"the search for {SEARCHED!r} finds nothing"
        print(
            f"visited: {len(chosen)} pages; {SEARCHED!r}: {page.locator('#search-results li').count()} hits"
        )
        browser.close()


def main() -> int:
    """Check a site; write links to other servers into external_links.txt."""
    site = Path(sys.argv[1]).resolve()
    wrong, linked = [], defaultdict(set)
    for path in sorted(site.rglob("*")):
        if path.suffix in (".html", ".css", ".js", ".svg"):
            name = path.relative_to(site).as_posix()
            loaded, links = read(path)
            wrong += [f"{name} loads {url}" for url in loaded]
            for url in links:
                linked[url].add(name)
    lines = [f"{url}  ({', '.join(sorted(pages)[:3])})" for url, pages in sorted(linked.items())]
    (site / "external_links.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{len(lines)} links to other servers: {site}/external_links.txt")
    if "--browser" in sys.argv:
        if shutil.which("chromium"):
            wrong += visit(site)
        else:
            print("not visited: needs Chromium")
    for line in wrong:
        print(f"not of this site: {line}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
