"""Render the raw images of a scene: `python -m rendering.render NAME`, in the environment with Blender.

Renders existing images again only if the scene's file has changed, not if this program has.
"""

import sys
import time

from rendering.layout import Layout
from rendering.raw import begin, missing
from rendering.scene import output_folder, scene_file, scene_from_arguments
from rendering.stage import Stage

__all__ = ["main"]


def main() -> None:
    """Render the missing images of one scene."""
    name, scene = scene_from_arguments(sys.argv[1:])
    folder, layout = output_folder(name) / "raw", Layout(scene)
    begin(folder, scene_file(name).read_bytes())
    images = missing(folder, layout.poses)
    print(f"{name}: {len(images)} images to render", flush=True)
    if not images:
        return
    stage = Stage(layout)
    for file, pose in images.items():
        begun_s = time.monotonic()
        stage.render(file, pose, None if pose is None else layout.changing_px())
        print(f"  {file.name} in {time.monotonic() - begun_s:.0f} s", flush=True)


if __name__ == "__main__":
    main()
