"""How far off `haptigraph register` lands on random simulated scenes, and whether it refuses what is no eye.

`python benchmarks/registration.py [SCENES [SEED]]`; 40 scenes take some minutes.
"""

import sys

import numpy as np

from haptigraph.analysis.registering import sound_anatomy
from haptigraph.analysis.registration_sweep import errors_px, invalid_pictures, random_view
from haptigraph.errors import BadInput

LIMITS_PX = {"center_px": 1.5, "radius_px": 1.5, "retina_px": 2.0}
INVALID_EVERY = 8  # scenes


def main() -> None:
    """Print one line per scene, then the distribution."""
    scenes = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    groups: dict[str, list[list[float]]] = {}
    refused = 0
    for number in range(scenes):
        view = random_view(number, seed)
        try:
            anatomy = sound_anatomy(view.images, 2 * view.radius_mm, view.says)
        except BadInput as error:
            refused += 1
            print(f"{number:3d}  REFUSED {error}", flush=True)
            continue
        errors = errors_px(anatomy, view)
        row = [errors.center_px, errors.radius_px, errors.retina_px, errors.trocar_px]
        groups.setdefault(view.group, []).append([*row, anatomy.rim_doubt_px])
        wrong = "" if all(getattr(errors, name) <= most for name, most in LIMITS_PX.items()) else "  OVER"
        told = "  ".join(f"{value:5.2f}" for value in row)
        print(
            f"{number:3d}  {told}  {view.says}; uncertain by {anatomy.rim_doubt_px:.1f} px{wrong}", flush=True
        )
    for title, found in sorted(groups.items(), reverse=True):
        report(title, np.array(found))
    print(f"valid scenes refused: {refused} of {scenes}")
    pictures = [pair for number in range(0, scenes, INVALID_EVERY) for pair in invalid_pictures(number, seed)]
    taken = [name for name, image in pictures if not is_refused(image, name)]
    print(
        f"invalid pictures taken for an eye: {len(taken)} of {len(pictures)} {sorted(taken) if taken else ''}"
    )


def report(title: str, found: np.ndarray) -> None:
    """Print the distribution of (scenes, 5): errors and what is told of them."""
    print(f"\n{title}: {len(found)} scenes")
    for name, column in zip(("centre", "radius", "retina", "trocars"), found.T, strict=False):
        seen = column[np.isfinite(column)]
        middle, p95, worst = np.quantile(seen, (0.5, 0.95, 1.0)) if len(seen) else (np.nan,) * 3
        print(f"  {name:8} median {middle:.2f}  p95 {p95:.2f}  worst {worst:.2f} px")
    limits = np.array(list(LIMITS_PX.values()))
    share = np.mean((found[:, :3] <= limits).all(axis=1))
    told = np.mean((found[:, :3] <= 2 * found[:, 4:]).all(axis=1))
    print(
        f"  within {' / '.join(f'{limit:g}' for limit in limits)} px: {share:.1%}; "
        f"within twice the uncertainty told: {told:.1%}"
    )


def is_refused(image: np.ndarray, name: str) -> bool:
    """Tell whether a picture is refused, and print why."""
    try:
        sound_anatomy([image], 24.0, name)
    except BadInput as error:
        print(f"  {error}", flush=True)
        return True
    return False


if __name__ == "__main__":
    main()
