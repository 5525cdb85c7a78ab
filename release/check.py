"""What is still to be done before a release: `python -m release.check`, after `make wheels`.

Prints a line for each item of docs/how_to/release.md. Exit code 1: something is missing.
"""

import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

from release.targets import TARGETS

__all__ = ["ITEMS", "main"]

ROOT = Path(__file__).parents[1]
CITED = ("cff-version: ", "message: ", "title: ", "authors:")


def main(root: Path = ROOT) -> int:
    """Print every item; return the exit code."""
    version = version_of(root)
    problems = {name: problem(root, version) for name, problem in ITEMS.items()}
    print(f"haptigraph {version}")
    for name, found in problems.items():
        print(f"{'not done' if found else 'done':10}{name}{': ' if found else ''}{found}")
    return int(any(problems.values()))


def version_of(root: Path) -> str:
    """Return the version in version.py."""
    text = (root / "haptigraph/version.py").read_text(encoding="utf-8")
    return re.findall(r'^__version__ = "(.+)"$', text, re.MULTILINE)[0]


def changes(root: Path, version: str) -> str:
    """Compare the newest section of the change log."""
    newest = re.search(r"^## (.+)$", (root / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    found = newest[1] if newest else "nothing"
    expected = rf"{re.escape(version)} \(\d{{4}}-\d\d-\d\d\)"
    return "" if re.fullmatch(expected, found) else f"begins with {found!r}, not '{version} (YYYY-MM-DD)'"


def upgrading(root: Path, version: str) -> str:
    """Look for the version in the page about upgrading."""
    title = (root / "docs/reference/upgrading.md").read_text(encoding="utf-8").partition("\n")[0]
    return "" if version in title else f"its title does not name {version}"


def citation(root: Path, version: str) -> str:
    """Check the keys that every citation file has, and its version."""
    lines = (root / "CITATION.cff").read_text(encoding="utf-8").splitlines()
    if missing := [key.strip(": ") for key in CITED if not any(line.startswith(key) for line in lines)]:
        return f"lacks {', '.join(missing)}"
    return "" if f"version: {version}" in lines else f"does not have version: {version}"


def addresses(root: Path, version: str) -> str:
    """Look for addresses in the metadata."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    missing = [] if project.get("urls", {}).get("Repository") else ["project.urls has no Repository"]
    if not any("email" in author for author in project["authors"]):
        missing.append("project.authors has no email")
    return "; ".join(missing)


def packages(root: Path, version: str) -> str:
    """Look for the sdist and the wheel of every platform."""
    names = [f"haptigraph-{version}.tar.gz"]
    names += [f"haptigraph-{version}-py3-none-{target.tag}.whl" for target in TARGETS]
    if missing := [name for name in names if not (root / "dist" / name).is_file()]:
        return f"run make wheels; dist lacks {', '.join(missing)}"
    others = sorted({file.name for file in (root / "dist").iterdir()} - {*names})
    return f"dist also has {', '.join(others)}" if others else ""


def readable(root: Path, version: str) -> str:
    """Let twine check what a package index reads."""
    files = sorted(str(file) for file in (root / "dist").glob("haptigraph-*"))
    if not files:
        return "dist has no packages"
    command = [sys.executable, "-m", "twine", "--no-color", "check", "--strict", *files]
    done = subprocess.run(command, capture_output=True, text=True)
    return (done.stdout or done.stderr).strip().rpartition("\n")[2] if done.returncode else ""


def committed(root: Path, version: str) -> str:
    """Look for changes outside a commit."""
    changed = git(root, "status", "--porcelain").splitlines()
    return f"{len(changed)} files differ from the last commit, first {changed[0][3:]}" if changed else ""


def tagged(root: Path, version: str) -> str:
    """Look for the tag of this commit."""
    tags = git(root, "tag", "--points-at", "HEAD").split()
    return "" if f"v{version}" in tags else f"git tag v{version}"


def git(root: Path, *arguments: str) -> str:
    """Return what git prints."""
    return subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=True).stdout


ITEMS: dict[str, Callable[[Path, str], str]] = {
    "change log": changes,
    "upgrading page": upgrading,
    "citation": citation,
    "addresses": addresses,
    "packages": packages,
    "twine": readable,
    "commit": committed,
    "tag": tagged,
}
"""Each returns what is missing; empty: it is done."""

if __name__ == "__main__":
    sys.exit(main())
