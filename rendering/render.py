"""Render the raw images of a scene: `python -m rendering.render NAME`, in the Python that has Blender.

An image that is there already is not rendered again, unless the scene's file has changed since. Whether this
program has changed is not asked.
"""

import sys
import time

from rendering.layout import Layout
from rendering.raw import begin, missing
from rendering.scene import asked_scene, output_folder, scene_file
from rendering.stage import Stage

__all__ = ["main"]


def main() -> None:
    """Render what is missing of one scene."""
    name, scene = asked_scene(sys.argv[1:])
    folder, layout = output_folder(name) / "raw", Layout(scene)
    begin(folder, scene_file(name).read_bytes())
    images = missing(folder, layout.poses)
    print(f"{name}: {len(images)} images to render", flush=True)
    if not images:
        return
    stage = Stage(layout)
    for file, pose in images.items():
        begun_s = time.monotonic()
        stage.render(file, pose)
        print(f"  {file.name} in {time.monotonic() - begun_s:.0f} s", flush=True)


if __name__ == "__main__":
    main()
