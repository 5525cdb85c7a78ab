"""Errors of `haptigraph register` on random simulated scenes, and its refusal of invalid pictures.

`python benchmarks/registration.py [SCENES [SEED]]`; 40 scenes take some minutes.
"""

import math
import sys
from collections.abc import Iterator
from itertools import islice

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.analysis.registering.registering import plausible_anatomy
from haptigraph.errors import BadInput
from haptigraph.geometry import Vec
from haptigraph.messages import Image
from haptigraph.perception.anatomy.anatomy import Anatomy
from haptigraph.projection import ImageGeometry
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenes import random_scene

MAX_TILT_DEG = 15.0
DISTANCE_MM = (50.0, 1000.0)
RIM_MM = (0.2, 0.8)
EVERY = 4  # only every fourth image of a scene is used


class View(Struct, frozen=True, eq=False):
    """One scene to register."""

    label: str
    images: tuple[Image, ...]
    truth: ImageGeometry
    radius_mm: float
    trocars_mm: tuple[Vec, ...]
    """The one in use, then the other."""
    group: str
    """Difficulty: the rim is in the section, or in front of it with or without a visible needle."""


class ViewErrors(Struct, frozen=True):
    """Errors of one registration [px]."""

    center_px: float
    radius_px: float
    retina_px: float
    """Largest error of the contour, perpendicular to it."""
    trocar_px: float
    """Largest distance of a detected trocar from the nearest true one; nan if none was detected."""


def random_view(number: int, seed: int = 0) -> View:
    """Draw one scene, which depends on number and seed only."""
    rng = np.random.default_rng((seed, 11, number))
    scene = random_scene(number, seed)
    turn, tilt_deg = rng.uniform(0, 2 * math.pi), rng.uniform(2, MAX_TILT_DEG) * (number % 3 > 0)
    distance_mm = float(np.exp(rng.uniform(*np.log(DISTANCE_MM))))
    rim_mm = rng.uniform(*RIM_MM) * min(1.0, distance_mm / 100) if number % 4 == 3 else 0.0
    scenario = scene.scenario
    phantom = Phantom(
        replace(
            scenario,
            eye=replace(scenario.eye, rim_mm=rim_mm),
            camera=replace(
                scenario.camera,
                tilt_deg=(tilt_deg * math.cos(turn), tilt_deg * math.sin(turn)),
                distance_mm=distance_mm,
            ),
        )
    )
    has_needle = not all(move.away for move in scenario.moves)
    is_single = number % 5 == 4
    if is_single:
        bare = replace(scenario.moves[0], away=True)
        phantom = Phantom(replace(phantom.scenario, moves=(bare,)))
    moments = islice(iter(phantom.advance, None), 1 if is_single else None)
    images = [moment.image for moment in moments]
    needle = "one image" if is_single else "needle" if has_needle else "no needle"
    return View(
        label=f"{scene.nuisance}, {needle}, tilt {tilt_deg:.0f} deg, camera at {distance_mm:.0f} mm, "
        f"rim {rim_mm:.1f} mm in front",
        images=tuple(images[::EVERY]),
        truth=phantom.camera.geometry,
        radius_mm=phantom.eye.radius_mm,
        trocars_mm=(phantom.eye.trocar_mm, phantom.eye.other_trocar_mm),
        group=f"rim in front, {'' if needle == 'needle' else 'no '}needle"
        if rim_mm
        else "rim in the section",
    )


def errors_px(anatomy: Anatomy, view: View) -> ViewErrors:
    """Compare a registration with the ground truth, in the camera's image."""
    truth, radius_px = view.truth, view.radius_mm / view.truth.mm_per_px
    trocars = [truth.to_px(trocar_mm) for trocar_mm in view.trocars_mm]
    found = [anatomy.image_px(trocar.point_px) for trocar in anatomy.trocars]
    retina_errors_px = [
        abs(math.hypot(*truth.to_mm(anatomy.image_px(point_px))) - view.radius_mm) / truth.mm_per_px
        for point_px in anatomy.contour_px
    ]
    return ViewErrors(
        center_px=math.dist(anatomy.image_px(anatomy.center_px), truth.to_px((0.0, 0.0))),
        radius_px=abs(anatomy.radius_px - radius_px),
        retina_px=max(retina_errors_px),
        trocar_px=max((min(math.dist(a, b) for b in trocars) for a in found), default=math.nan),
    )


def invalid_pictures(number: int, seed: int = 0) -> Iterator[tuple[str, Image]]:
    """Yield pictures in which no globe can be measured, with their names: degraded eyes and other objects."""
    view = random_view(number, seed)
    eye, (x, y) = view.images[0], view.truth.to_px((0.0, 0.0))
    radius_px = view.radius_mm / view.truth.mm_per_px
    height, width = eye.shape[:2]
    rng = np.random.default_rng((seed, 12, number))
    part = rng.uniform(0.3, 0.9)
    yield "cut off on the right", np.ascontiguousarray(eye[:, : round(x + part * radius_px)])
    yield "cut off on the left", np.ascontiguousarray(eye[:, round(x - part * radius_px) :])
    yield "cut off below", np.ascontiguousarray(eye[: round(y + part * radius_px)])
    yield "cut off above", np.ascontiguousarray(eye[round(y - part * radius_px) :])
    yield (
        "blurred away",
        np.asarray(cv2.GaussianBlur(eye, (0, 0), rng.uniform(0.07, 0.2) * radius_px), np.uint8),
    )
    yield (
        "far away",
        np.asarray(cv2.resize(eye, None, fx=0.2, fy=0.2, interpolation=cv2.INTER_AREA), np.uint8),
    )
    yield "overexposed", np.asarray(cv2.convertScaleAbs(eye, alpha=20), np.uint8)
    yield "lens cap", np.asarray(cv2.convertScaleAbs(eye, alpha=0.01), np.uint8)
    yield "one colour", np.full_like(eye, rng.integers(0, 256))
    yield "noise", rng.integers(0, 256, eye.shape, np.uint8)
    cells = (int(rng.integers(20, 200)), int(rng.integers(20, 200)))
    grain = cv2.resize(
        rng.uniform(60, 200, cells).astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC
    )
    yield "wood", np.asarray(cv2.merge([np.clip(grain, 0, 255).astype(np.uint8)] * 3), np.uint8)
    yield "ball", _disc(eye, rng)
    yield "box", _boxes(eye, rng)


def _disc(eye: Image, rng: np.random.Generator) -> Image:
    """Return a picture of a disc."""
    canvas = np.full_like(eye, 90)
    center = round(canvas.shape[1] * rng.uniform(0.4, 0.6)), canvas.shape[0] // 2
    cv2.circle(
        canvas,
        center,
        round(canvas.shape[0] * rng.uniform(0.2, 0.4)),
        (200, 190, 180),
        cv2.FILLED,
        cv2.LINE_AA,
    )
    return canvas


def _boxes(eye: Image, rng: np.random.Generator) -> Image:
    """Return a picture of overlapping quadrangles."""
    canvas = np.full_like(eye, 70)
    for _ in range(40):
        corners = rng.uniform((0, 0), eye.shape[1::-1]) + rng.uniform(-200, 200, (4, 2))
        cv2.fillConvexPoly(
            canvas, cv2.convexHull(corners.astype(np.int32)), rng.uniform(0, 255, 3).tolist(), cv2.LINE_AA
        )
    return canvas


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
            anatomy = plausible_anatomy(view.images, 2 * view.radius_mm, view.label)
        except BadInput as error:
            refused += 1
            print(f"{number:3d}  REFUSED {error}", flush=True)
            continue
        errors = errors_px(anatomy, view)
        row = [errors.center_px, errors.radius_px, errors.retina_px, errors.trocar_px]
        groups.setdefault(view.group, []).append([*row, anatomy.rim_uncertainty_px])
        is_within = all(getattr(errors, name) <= limit for name, limit in LIMITS_PX.items())
        text = "  ".join(f"{value:5.2f}" for value in row)
        text += f"  {view.label}; uncertainty {anatomy.rim_uncertainty_px:.1f} px"
        print(f"{number:3d}  {text}{'' if is_within else '  OVER'}", flush=True)
    for title, found in sorted(groups.items(), reverse=True):
        report(title, np.array(found))
    print(f"valid scenes refused: {refused} of {scenes}")
    pictures = [pair for number in range(0, scenes, INVALID_EVERY) for pair in invalid_pictures(number, seed)]
    accepted = sorted(name for name, image in pictures if not is_refused(image, name))
    print(f"invalid pictures accepted: {len(accepted)} of {len(pictures)} {accepted or ''}")


def report(title: str, found: np.ndarray) -> None:
    """Print the distribution of (scenes, 5): four errors and the reported uncertainty."""
    print(f"\n{title}: {len(found)} scenes")
    for name, column in zip(("centre", "radius", "retina", "trocars"), found.T, strict=False):
        detected = column[np.isfinite(column)]
        median, p95, maximum = np.quantile(detected, (0.5, 0.95, 1.0)) if len(detected) else (np.nan,) * 3
        print(f"  {name:8} median {median:.2f}  p95 {p95:.2f}  max {maximum:.2f} px")
    limits = np.array(list(LIMITS_PX.values()))
    share = np.mean((found[:, :3] <= limits).all(axis=1))
    covered = np.mean((found[:, :3] <= 2 * found[:, 4:]).all(axis=1))
    print(
        f"  within {' / '.join(f'{limit:g}' for limit in limits)} px: {share:.1%}; "
        f"within twice the reported uncertainty: {covered:.1%}"
    )


def is_refused(image: np.ndarray, name: str) -> bool:
    """Return whether a picture is refused, and print the reason."""
    try:
        plausible_anatomy([image], 24.0, name)
    except BadInput as error:
        print(f"  {error}", flush=True)
        return True
    return False


if __name__ == "__main__":
    main()
