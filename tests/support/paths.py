"""Where things lie that tests read."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
"""Of the repository."""
DATA = ROOT / "tests" / "data"
GOLDEN = ROOT / "tests" / "replay" / "golden"
RENDERINGS = DATA / "renderings"
SHARED = ROOT.parent / "shared"
"""Labelled clips beside the checkout, where they are; tests over them skip, visibly, where they are not."""
