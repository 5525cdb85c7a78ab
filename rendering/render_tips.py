"""Render what is about tips in scenes drawn by lot: `python -m rendering.render_tips FIRST STOP`.

In the environment with Blender. Existing images are kept.
"""

import sys

from rendering.layout import Layout
from rendering.lot import drawn_scene
from rendering.stage import Stage
from rendering.tips import SMALLER, box_px, file_of, needle_name, poses_of, union_px

__all__ = ["main"]


def main() -> None:
    """Render the missing images of the scenes with the numbers FIRST to STOP - 1."""
    try:
        numbers = range(*(int(argument) for argument in sys.argv[1:3]))
    except (TypeError, ValueError):
        print("rendering: give the first number and the one after the last, as in 1 129", file=sys.stderr)
        raise SystemExit(2) from None
    for number in numbers:
        _render(number)


def _render(number: int) -> None:
    layout = Layout(drawn_scene(number))
    poses = poses_of(layout)
    boxes = [box_px(layout, layout.placed(pose)) for pose in poses]
    wanted = {"around": (None, None), "empty": (None, union_px(boxes))}
    wanted |= {needle_name(at): each for at, each in enumerate(zip(poses, boxes, strict=True))}
    missing = {name: how for name, how in wanted.items() if not file_of(number, name).exists()}
    if not missing:
        return
    file_of(number, "around").parent.mkdir(parents=True, exist_ok=True)
    stage = Stage(layout)
    for name, (pose, box) in missing.items():
        stage.render(file_of(number, name), pose, box, 1 if box else SMALLER)
    print(f"{number}: {len(poses)} needles", flush=True)


if __name__ == "__main__":
    main()
