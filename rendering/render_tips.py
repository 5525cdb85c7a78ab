"""Render scenes drawn by lot, which the tip network learns from: `python -m rendering.render_tips`.

Or those that it does not learn from: `--unseen`. In the environment with Blender. Existing images are kept.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path

from rendering.layout import Layout
from rendering.lot import LEARNED, UNSEEN, drawn_scene
from rendering.stage import Stage
from rendering.tips import SMALLER, Part, file_of, parts_of

__all__ = ["main"]


def main() -> None:
    """Render the missing images of all scenes."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: python -m rendering.render_tips --unseen",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--unseen", action="store_true", help="those that test its certainty instead")
    for number in UNSEEN if parser.parse_args().unseen else LEARNED:
        layout = Layout(drawn_scene(number))
        missing = {
            file: part
            for name, part in parts_of(layout).items()
            if not (file := file_of(number, name)).exists()
        }
        if missing:
            _render(layout, missing)
            print(f"scene {number}: {len(missing)} images", flush=True)


def _render(layout: Layout, missing: Mapping[Path, Part]) -> None:
    stage = Stage(layout)
    for file, (pose, box) in missing.items():
        file.parent.mkdir(parents=True, exist_ok=True)
        stage.render(file, pose, box, 1 if box else SMALLER)


if __name__ == "__main__":
    main()
