"""Simulated lenses: registration after a calibration with a sheet, and the warning without one.

`python benchmarks/lens.py [SCENES [RIMS [SEED]]]`: SCENES eyes with barrel and as many with pincushion
distortion of 2 to 8 % in the middle of the image's side are registered after a calibration by simulated
pictures. RIMS eyes each without, with barrel and with pincushion distortion are registered without one, by
their rims alone.
"""

import math
import sys
from collections.abc import Callable
from itertools import product

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.analysis.calibrating.board import CELLS, Board
from haptigraph.analysis.calibrating.calibrating import find_views
from haptigraph.analysis.calibrating.calibration import calibrate
from haptigraph.analysis.registering.overrides import MAX_LENS_RISK_PX
from haptigraph.analysis.registering.registering import plausible_anatomy
from haptigraph.errors import BadInput
from haptigraph.geometry import Vec
from haptigraph.imaging import Floats, tilt_restored
from haptigraph.lens import Lens
from haptigraph.messages import Image
from haptigraph.perception.anatomy.anatomy import Anatomy
from haptigraph.perception.anatomy.camera_tilt import edge_points, find_camera_tilt
from haptigraph.perception.anatomy.edge import Edge
from haptigraph.perception.anatomy.lens_risk import lens_risk_px
from haptigraph.perception.anatomy.rim import Rim
from haptigraph.projection import ImageGeometry, ImageMap, LensMap
from haptigraph.registration.tilt import CameraTilt
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenes import random_scene

SIZES_PX = (1280, 720), (1920, 1080)
SHARES = (0.02, 0.08)
FOCAL_WIDTHS = (0.5, 1.25)  # relative to the width of the image
RADIUS = (0.21, 0.46)  # of the globe, relative to the height of the image
MAX_TILT_DEG = 8.0
CLEAR_PX = 24.0  # between globe and border
BOARD = Board(24, 17)
SHEET_VIEWS = 20
CELL_TEXELS, TEXEL_BLUR = 6, 0.6  # so that a square has about as many texels as pixels
AIMS = 5, 4  # columns and rows of places where the sheet is shown in turn
SECTION = [
    (reach * math.cos(turn), reach * math.sin(turn))
    for reach in np.linspace(0, 1, 7).tolist()
    for turn in np.linspace(0, 2 * math.pi, 24, endpoint=False).tolist()
]
RAYS, RAY_SD_PX, IRREGULAR = 720, 0.3, 0.12 / 250  # of a measured rim
LIMIT_PX = 1.5
DEFAULTS = "20", "100", "1"

Rng = np.random.Generator


class LensScene(Struct, frozen=True, eq=False):
    """An eye before a camera with a lens."""

    image: Image
    truth: ImageGeometry
    radius_mm: float
    lens: Lens
    share: float


def simulated_lens(share: float, focal_px: float, rng: Rng, size_px: tuple[int, int] = SIZES_PX[0]) -> Lens:
    """Return a lens that moves points in the middle of the image's side by a share of their distance."""
    side = size_px[0] / 2 / focal_px / (1 + share)  # before the distortion, at unit distance
    bend = rng.uniform(-0.2, 0.2) if share else 0.0
    decentred = rng.normal(0, 3e-4, 2) * bool(share)
    k1, k2 = share * (1 - bend) / side**2, share * bend / side**4
    middle = (size_px[0] - 1) / 2 + rng.normal(0, 8), (size_px[1] - 1) / 2 + rng.normal(0, 8)
    aspect = 1 + rng.normal(0, 5e-4)
    return Lens((focal_px * aspect, focal_px / aspect), middle, (k1, k2, *map(float, decentred), 0.0))


def lens_scene(number: int, sign: int, seed: int = 0) -> LensScene:
    """Draw an eye and a lens: barrel for a sign of -1, pincushion for +1, none for 0."""
    rng = np.random.default_rng((seed, 34, number, sign + 1))
    size_px = SIZES_PX[number // 2 % 2]
    scenario = random_scene(number + 1000 * (sign + 1), seed, size_px=size_px).scenario
    share, focal_px, radius_px = drawn_camera(rng, sign, size_px)
    px_per_mm = radius_px / (scenario.eye.diameter_mm / 2)
    tilt_rad = drawn_tilt(rng, number)
    center_px = drawn_center(rng, size_px, radius_px + scenario.eye.wall_mm * px_per_mm, share)
    camera = replace(
        scenario.camera, px_per_mm=px_per_mm, center_px=center_px, distance_mm=focal_px / px_per_mm
    )
    phantom = Phantom(replace(scenario, camera=camera))
    lens = simulated_lens(share, focal_px, rng, size_px)
    moment = next(iter(phantom.advance, None))
    view = lens_view(lens, center_px, tilt_rad)
    return LensScene(
        image=tilt_restored(moment.image, view),
        truth=replace(phantom.camera.geometry, frontal_from_image=view),
        radius_mm=phantom.eye.radius_mm,
        lens=lens,
        share=share,
    )


def lens_view(lens: Lens, about_px: Vec, tilt_rad: Vec) -> LensMap:
    """Return the map to the frontal view from a camera's image: tilt and lens have one principal point."""
    tilt = CameraTilt(about_px, tilt_rad, lens.ideal_focal_px, lens.principal_px)
    return LensMap(lens, tilt.frontal_from_image if any(tilt_rad) else None)


def drawn_camera(rng: Rng, sign: int, size_px: tuple[int, int]) -> tuple[float, float, float]:
    """Draw distortion, focal length and radius of the globe [px]."""
    share, focal = sign * rng.uniform(*SHARES), float(np.exp(rng.uniform(*np.log(FOCAL_WIDTHS))))
    return share, focal * size_px[0], rng.uniform(*RADIUS) * size_px[1]


def drawn_center(rng: Rng, size_px: tuple[int, int], reach_px: float, share: float) -> Vec:
    """Draw a centre of the globe so that it is wholly in the image."""
    room = [max(side / 2 * (1 + min(share, 0)) - reach_px - CLEAR_PX, 0.0) for side in size_px]
    right, down = (side / 2 + rng.uniform(-each, each) for side, each in zip(size_px, room, strict=True))
    return right, down


def drawn_tilt(rng: Rng, number: int) -> Vec:
    """Draw (right, down) components of the tilt; every other camera has none [rad]."""
    turn, tilt = rng.uniform(0, 2 * math.pi), math.radians(rng.uniform(1, MAX_TILT_DEG)) * (number % 2)
    return tilt * math.cos(turn), tilt * math.sin(turn)


class SheetCamera:
    """Take pictures of the sheet in random poses, with blur and noise."""

    def __init__(self, lens: Lens, board: Board, rng: Rng, size_px: tuple[int, int] = SIZES_PX[0]) -> None:
        self._lens, self._rng, self._size_px = lens, rng, size_px
        self._squares = board.columns, board.rows
        bitmap = cv2.copyMakeBorder(board.bitmap, *[CELLS] * 4, cv2.BORDER_CONSTANT, value=255)
        sharp = cv2.resize(bitmap, None, fx=CELL_TEXELS, fy=CELL_TEXELS, interpolation=cv2.INTER_NEAREST)
        self._texture = cv2.GaussianBlur(sharp, (0, 0), TEXEL_BLUR)
        self._number = 0
        width, height = size_px
        x, y = np.meshgrid(np.arange(width), np.arange(height))
        pixels = np.stack([x, y], axis=-1).reshape(-1, 1, 2).astype(np.float64)
        (across, down), middle = lens.focal_px, lens.principal_px
        camera = np.array([[across, 0, middle[0]], [0, down, middle[1]], [0, 0, 1]])
        stop = (cv2.TERM_CRITERIA_COUNT, 20, 1e-6)
        self._rays = cv2.undistortPointsIter(
            pixels, camera, np.array(lens.distortion), np.eye(3), np.eye(3), stop
        )

    def picture(self) -> Image:
        """Return the next picture."""
        rng, (width, height) = self._rng, self._size_px
        focal, middle = self._lens.ideal_focal_px, np.array(self._lens.principal_px)
        square_px = rng.uniform(0.035, 0.07) * width
        tilt, turn = math.radians(rng.uniform(5, 40)), rng.uniform(0, 2 * math.pi)
        rotation = cv2.Rodrigues(np.array([math.cos(turn), math.sin(turn), 0.0]) * tilt)[0]
        rotation = rotation @ cv2.Rodrigues(np.array([0.0, 0.0, rng.normal(0, 0.5)]))[0]
        # A random part of the sheet appears at a random place.
        aim = np.array([*((self._aim_px() - middle) / focal), 1.0])
        part = np.array(self._squares) * rng.uniform(0.3, 0.7, 2)
        shift = aim * focal / square_px - rotation[:, :2] @ part
        board_from_rays = np.linalg.inv(np.column_stack([rotation[:, :2], shift]))
        squares = cv2.perspectiveTransform(self._rays, board_from_rays)
        texels = CELLS * CELL_TEXELS
        at = (squares.reshape(height, width, 2) * texels + texels - 0.5).astype(np.float32)
        seen = cv2.remap(self._texture, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=90)
        lit = cv2.GaussianBlur(
            25 + seen.astype(np.float64) * rng.uniform(0.5, 0.75), (0, 0), rng.uniform(0.5, 1.2)
        )
        return np.clip(lit + rng.normal(0, rng.uniform(1, 4), lit.shape), 0, 255).astype(np.uint8)

    def _aim_px(self) -> Floats:
        row, column = divmod(self._number, AIMS[0])
        self._number = (self._number + 1) % math.prod(AIMS)
        return (self._rng.uniform(0, 1, 2) + np.array([column, row])) / AIMS * self._size_px


def rim_seen(
    to_image: Callable[[Vec], Vec], center_px: Vec, radius_px: float, rng: Rng, wall_ratio: float = 1.1
) -> Rim:
    """Return the rim of an eye as `find_rim` would measure it: slightly irregular, with noise.

    Args:
        to_image: From the frontal image without distortion to the camera's.
        center_px: Centre of the globe in the frontal image.
        radius_px: Its radius there.
        rng: Draws irregularities and noise.
        wall_ratio: Outer over inner radius of the wall.
    """
    turns = np.arange(RAYS) * 2 * math.pi / RAYS
    edges = []
    for radius in (radius_px, radius_px * wall_ratio):
        waves = [rng.normal(0, IRREGULAR) * np.cos(n * turns + rng.uniform(0, 7)) for n in range(2, 7)]
        reach = radius + radius_px * sum(waves)
        ideal = np.stack([center_px[0] + reach * np.sin(turns), center_px[1] + reach * np.cos(turns)], axis=1)
        seen = np.array([to_image((x, y)) for x, y in ideal.tolist()])
        edges.append(edge_through(seen + rng.normal(0, RAY_SD_PX, seen.shape)))
    return Rim(*edges)


def edge_through(points_px: Floats) -> Edge:
    """Return the edge through points all around it, (n, 2)."""
    center, harmonics = points_px.mean(axis=0), np.zeros(5)
    for _ in range(4):
        center = center + harmonics[[2, 1]]
        offset = points_px - center
        angles, radii = np.arctan2(*offset.T), np.hypot(*offset.T)
        basis = np.stack([angles * 0 + 1, *(f(n * angles) for n in (1, 2) for f in (np.cos, np.sin))], axis=1)
        harmonics = np.linalg.lstsq(basis, radii, rcond=None)[0]
    return Edge((float(center[0]), float(center[1])), harmonics, angles, radii - basis @ harmonics, 1.0, 1.0)


def through(edge: Edge, to_frontal: ImageMap) -> Edge:
    """Return an edge in the frontal view."""
    return edge_through(np.array([to_frontal((x, y)) for x, y in edge_points(edge).tolist()]))


def uncalibrated(number: int, sign: int, seed: int) -> tuple[float, float]:
    """Register the rim of a drawn eye without calibration; return the largest error and the risk [px]."""
    rng = np.random.default_rng((seed, 36, number, sign + 1))
    size_px = SIZES_PX[number // 2 % 2]
    middle = (size_px[0] - 1) / 2, (size_px[1] - 1) / 2
    share, focal_px, radius_px = drawn_camera(rng, sign, size_px)
    wall_ratio = rng.uniform(1.05, 1.2)
    center = drawn_center(rng, size_px, radius_px * wall_ratio, share)
    tilt_rad = drawn_tilt(rng, number)
    truth = lens_view(simulated_lens(share, focal_px, rng, size_px), center, tilt_rad)
    rim = rim_seen(truth.inverse, center, radius_px, rng, wall_ratio)
    found = find_camera_tilt(rim, middle)
    if found is not None:
        rim = Rim(*(through(edge, found.frontal_from_image) for edge in (rim.inner, rim.outer)))
    error = 0.0
    for x, y in SECTION:
        at = truth.inverse((center[0] + radius_px * x, center[1] + radius_px * y))
        at = found.frontal_from_image(at) if found else at
        offset = np.subtract(at, rim.inner.center_px) / rim.inner.radius_px - (x, y)
        error = max(error, radius_px * float(np.hypot(*offset)))
    return error, lens_risk_px(rim, found, size_px)


def section_error_px(anatomy: Anatomy, scene: LensScene) -> float:
    """Return the largest error of the registration in the section: its points, as seen and registered."""
    mm_per_px = scene.radius_mm / anatomy.radius_px
    image = ImageGeometry(anatomy.center_px, mm_per_px, scene.truth.mirrored, anatomy.frontal_map)
    points = [(float(x) * scene.radius_mm, float(y) * scene.radius_mm) for x, y in SECTION]
    errors_mm = [math.dist(image.to_mm(scene.truth.to_px(point)), point) for point in points]
    return max(errors_mm) / scene.truth.mm_per_px


def calibrated(lens: Lens, rng: Rng, size_px: tuple[int, int]) -> Lens:
    """Calibrate a lens with simulated pictures of the sheet."""
    camera = SheetCamera(lens, BOARD, rng, size_px)
    pictures = (camera.picture() for _ in range(SHEET_VIEWS))
    return calibrate(*find_views(pictures, BOARD, "simulated sheet")).lens


def main() -> None:
    """Print one line per scene, then the rates."""
    scenes, rims, seed = (int(text) for text in [*sys.argv[1:], *DEFAULTS[len(sys.argv) - 1 :]])
    errors: list[float] = []
    for sign, number in product((-1, 1), range(scenes)):
        scene = lens_scene(number, sign, seed)
        rng, size_px = np.random.default_rng((seed, 35, number, sign + 1)), scene.image.shape[1::-1]
        try:
            lens = calibrated(scene.lens, rng, size_px)
            anatomy = plausible_anatomy([scene.image], 2 * scene.radius_mm, "scene", lens=lens)
        except BadInput as error:
            print(f"{number:3d} {scene.share:+.1%}  REFUSED {error}", flush=True)
            continue
        errors.append(section_error_px(anatomy, scene))
        text = f"{errors[-1]:.2f} px, lens {lens.sd_px:.2f} px"
        print(f"{number:3d} {scene.share:+.1%}  {text}", flush=True)
    median, high = np.quantile(errors, (0.5, 0.95))
    print(
        f"after calibration: {len(errors)} of {2 * scenes} registered; "
        f"median {median:.2f}, 95 % {high:.2f}, maximum {max(errors):.2f} px; "
        f"within {LIMIT_PX} px: {np.mean(np.array(errors) <= LIMIT_PX):.1%}"
    )
    if rims:
        report_warnings(rims, seed)


def report_warnings(rims: int, seed: int) -> None:
    """Print which registrations without a calibration are wrong, and which are warned about."""
    rows = np.array(
        [(sign, *uncalibrated(number, sign, seed)) for sign, number in product((0, -1, 1), range(rims))]
    )
    off, is_warned = rows[:, 1] > MAX_LENS_RISK_PX, rows[:, 2] > MAX_LENS_RISK_PX
    print(f"without calibration: {off.sum()} of {len(rows)} registrations are more than 3 px off")
    for name, where in (
        ("of these, warned about", off),
        ("lenses without distortion warned about", rows[:, 0] == 0),
        ("lenses with distortion, at most 3 px off, warned about", (rows[:, 0] != 0) & ~off),
    ):
        print(f"  {name}: {is_warned[where].sum()} of {where.sum()}")


if __name__ == "__main__":
    main()
