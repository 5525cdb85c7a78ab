"""Refuse a built site that loads anything from elsewhere; list the links that a reader may follow.

python docs/outside.py build/docs
"""

import re
import sys
from collections import defaultdict
from pathlib import Path

LOADED = re.compile(
    r"""<(?:script|img|iframe|source|video|link|object|embed)\b[^>]*?\b(?:src|href|data)=["'](?P<url>(?:https?:)?//[^"']+)"""
)
"""Of HTML: what a browser fetches without being asked."""
STYLED = re.compile(r"""(?:url\(|@import\s+)["']?(?P<url>(?:https?:)?//[^"')]+)""")
LINKED = re.compile(r"""<a\b[^>]*?\bhref=["'](?P<url>https?://[^"'#]+)""")
SCRIPTED = re.compile(r"""(?:fetch|import|importScripts|XMLHttpRequest)\(\s*["'](?P<url>https?://[^"']+)""")


def main() -> int:
    """Check a site; write links to other servers into external_links.txt."""
    site = Path(sys.argv[1])
    loaded, linked = [], defaultdict(set)
    for path in sorted(site.rglob("*")):
        if path.suffix not in (".html", ".css", ".js"):
            continue
        text, name = path.read_text(encoding="utf-8"), path.relative_to(site).as_posix()
        patterns = {".html": (LOADED, STYLED), ".css": (STYLED,), ".js": (SCRIPTED,)}[path.suffix]
        loaded += [f"{name}: {found['url']}" for pattern in patterns for found in pattern.finditer(text)]
        if path.suffix == ".html":
            for found in LINKED.finditer(text):
                linked[found["url"]].add(name)
    lines = [f"{url}  ({', '.join(sorted(pages)[:3])})" for url, pages in sorted(linked.items())]
    (site / "external_links.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{len(lines)} links to other servers: {site}/external_links.txt")
    for line in loaded:
        print(f"loaded from elsewhere: {line}")
    return 1 if loaded else 0


if __name__ == "__main__":
    sys.exit(main())
