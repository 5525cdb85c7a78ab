"""Take pictures of a rig: `python -m rendering.rigs.render RIG.TOML MESHES OUT BUILDS`.

One as designed, and BUILDS as built. In the environment with Blender. Existing pictures are kept.
"""

import sys
import time
from pathlib import Path

from haptigraph.rig.description import load_rig
from rendering.rigs.builds import build_of, picture_file
from rendering.rigs.stage import RigStage

__all__ = ["main"]


def main() -> None:
    """Render the missing pictures: the rig as designed (0), and as built."""
    rig_file, meshes, folder, count = (
        Path(sys.argv[1]),
        Path(sys.argv[2]),
        Path(sys.argv[3]),
        int(sys.argv[4]),
    )
    if not any(meshes.glob("*.stl")):
        print(f"rendering: {meshes}: no STL files; make rig RIG={rig_file} writes them", file=sys.stderr)
        raise SystemExit(2)
    rig = load_rig(rig_file)
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(count + 1):
        file = picture_file(folder, number)
        if not file.exists():
            begun_s = time.monotonic()
            RigStage(rig, meshes, build_of(rig, number)).render(file)
            print(f"  {file} in {time.monotonic() - begun_s:.0f} s", flush=True)


if __name__ == "__main__":
    main()
