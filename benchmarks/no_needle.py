"""False detections: how often a perceiver reports a needle in images that show none.

`python benchmarks/no_needle.py [--seed N] [--perceiver NAME] [--pictures DIR]`. Sixty-five pictures are
drawn, five of each kind in the table: eyes of the simulator as they are registered, eyes elsewhere in
the image, and pictures without an eye. Each is shown 33 times to one run, with noise, changing light and
camera shake; before every other picture an object drifts. A picture without an eye is shown under the
registration of a usual eye.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.messages import Capture, Image
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.eye.distractors import Distractors
from haptigraph.sim.eye.eye import EyeShape
from haptigraph.sim.eye.optics import CameraSettings
from haptigraph.sim.eye.palette import Appearance
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.robot.operator import Move
from haptigraph.sim.scenario import About, Scenario, load_scenario

SIZE_PX = 1280, 720
OF_A_KIND, IMAGES = 5, 33
INTERVAL_NS = 33_333_333
NOISE_GREY, SHAKE_PX, LIGHT = 2.0, 1.5, 0.08
TEXT = "Remove the infusion line before the needle is drawn back through the trocar"

Rng = np.random.Generator


def main() -> None:
    """Draw the pictures, and print the images with a needle of each kind."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: python benchmarks/no_needle.py --seed 1 --pictures build/pictures",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seed", type=int, default=0, help="of pictures, noise and shake")
    parser.add_argument("--perceiver", default="tracker", help="tracker (default), forceps or threshold")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="write each picture as a PNG, too")
    given = parser.parse_args()
    config = load_config().with_perceiver(given.perceiver)
    procedure = assemble.load_procedure(config.run.procedure)
    print(f"{'kind':12}{'images':>8}{'with a needle':>16}   by picture", flush=True)
    shown = reported = 0
    for kind, draw in KINDS.items():
        counts = []
        for number in range(OF_A_KIND):
            rng = np.random.default_rng((given.seed, *kind.encode(), number))
            picture, registered = draw(rng)
            if given.pictures:
                given.pictures.mkdir(parents=True, exist_ok=True)
                cv2.imwrite(str(given.pictures / f"{kind}_{number}.png"), picture)
            registration = parse_registration(registered, kind)
            perceive = assemble.build_pipeline(config, registration, procedure).perceive
            captures = images_of(picture, rng, drifts=number % 2 == 1)
            counts.append(sum("needle_line" in perceive(capture).found for capture in captures))
        shown, reported = shown + OF_A_KIND * IMAGES, reported + sum(counts)
        print(f"{kind:12}{OF_A_KIND * IMAGES:8}{sum(counts):16}   {' '.join(map(str, counts))}", flush=True)
    print(f"{'all':12}{shown:8}{reported:16}   no needle in {1 - reported / shown:.2%}")


def images_of(picture: Image, rng: Rng, *, drifts: bool) -> Iterator[Capture]:
    """Yield a picture as a camera shows it; before every other one, an object drifts."""
    height, width = picture.shape[:2]
    place, step = rng.uniform((0, 0), (width, height)), rng.normal(0, 6, 2)
    color, radius_px = rng.uniform(0, 255, 3).tolist(), int(rng.integers(8, 60))
    turn_rad = rng.uniform(0, 2 * np.pi)
    for number in range(IMAGES):
        shown = picture.copy()
        if drifts:
            place = place + step
            cv2.circle(shown, tuple(map(int, place)), radius_px, color, cv2.FILLED, cv2.LINE_AA)
        (x, y), gain = rng.normal(0, SHAKE_PX, 2), 1 + LIGHT * np.sin(turn_rad + number / 5)
        matrix = np.array([[1, 0, x], [0, 1, y]])
        shown = cv2.warpAffine(shown, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE)
        noise = rng.standard_normal(shown.shape, np.float32) * np.float32(NOISE_GREY)
        image = np.clip(np.float32(gain) * shown + noise, 0, 255).astype(np.uint8)
        yield Capture(index=number, stamp_ns=number * INTERVAL_NS, image=image)


def empty_eye(rng: Rng, style: str) -> tuple[Image, str]:
    """Return an eye of the simulator without an instrument, and its registration."""
    eye = EyeShape(
        target_deg=rng.uniform(-15, 15), trocar_deg=float(rng.choice((-1, 1))) * rng.uniform(28, 42)
    )
    scenario = Scenario(
        about=About(description="An eye without a needle.", seed=int(rng.integers(2**31))),
        moves=(Move(1.0, -3.0, 0.0, away=True),),
        eye=eye,
        camera=CameraSettings(
            center_px=(640 + rng.uniform(-30, 30), 400 + rng.uniform(-10, 15)),
            px_per_mm=rng.uniform(18, 21),
            mirrored=bool(rng.integers(2)),
            blur_px=rng.uniform(0.7, 2.0),
        ),
        appearance=Appearance("dark" if style == "dark" else "light", texture=rng.uniform(0.5, 2.0)),
        distractors=Distractors(
            specular_highlights=int(rng.integers(0, 10)),
            vessels=int(rng.integers(0, 12)) if style == "clutter" else 0,
            lines=int(rng.integers(2, 12)) if style == "clutter" else 0,
            bubbles=int(rng.integers(0, 6)),
        ),
    )
    phantom = Phantom(scenario)
    moment = phantom.advance()
    if moment is None:
        raise RuntimeError("the scenario has no image")
    return moment.image, phantom.registration


def moved_eye(rng: Rng) -> tuple[Image, str]:
    """Return an eye that is not where it was registered."""
    image, registered = empty_eye(rng, str(rng.choice(("light", "dark"))))
    size, angle_deg = rng.uniform(0.4, 1.6), rng.uniform(-90, 90)
    matrix = cv2.getRotationMatrix2D((640, 400), angle_deg, size)
    matrix[:, 2] += rng.choice((-1, 1), 2) * rng.uniform((100, 60), (400, 200))
    return cv2.warpAffine(image, matrix, SIZE_PX, borderMode=cv2.BORDER_REFLECT), registered


def usual(draw: Callable[[Rng, Image], None]) -> Callable[[Rng], tuple[Image, str]]:
    """Return a function that draws on plain ground, to be shown under the registration of a usual eye."""

    def drawn(rng: Rng) -> tuple[Image, str]:
        ramp = np.linspace(rng.uniform(40, 220), rng.uniform(40, 220), SIZE_PX[0])
        tint = rng.uniform(0.7, 1.15, 3)
        ground = np.broadcast_to(ramp[None, :, None] * tint, (*SIZE_PX[::-1], 3))
        image = np.clip(ground, 0, 255).astype(np.uint8)
        draw(rng, image)
        soft = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.6, 2.0))
        return soft, Phantom(load_scenario("align_then_approach")).registration

    return drawn


def color(rng: Rng) -> Sequence[float]:
    """Return any colour."""
    return [float(value) for value in rng.uniform(0, 255, 3)]


def point(rng: Rng) -> tuple[int, int]:
    """Return any pixel."""
    return int(rng.integers(SIZE_PX[0])), int(rng.integers(SIZE_PX[1]))


def draw_nothing(_rng: Rng, _image: Image) -> None:
    """Leave the plain ground."""


def draw_grating(rng: Rng, image: Image) -> None:
    """Draw parallel stripes, straight or bent."""
    y, x = np.mgrid[: SIZE_PX[1], : SIZE_PX[0]]
    angle, period_px, bend = rng.uniform(0, np.pi), rng.uniform(6, 120), rng.choice((0, rng.uniform(0, 40)))
    phase = (x * np.cos(angle) + y * np.sin(angle) + bend * np.sin(x / 90)) * 2 * np.pi / period_px
    wave = np.sin(phase) if rng.random() < 0.5 else np.sign(np.sin(phase))
    image[:] = np.clip(image + rng.uniform(10, 90) * wave[..., None], 0, 255)


def draw_text(rng: Rng, image: Image) -> None:
    """Draw lines of text."""
    size, ink, step = rng.uniform(0.5, 3), color(rng), int(rng.integers(20, 90))
    for row in range(step, SIZE_PX[1] + step, step):
        cv2.putText(image, TEXT, (int(rng.integers(-200, 40)), row), cv2.FONT_HERSHEY_DUPLEX, size, ink, 2)


def draw_cables(rng: Rng, image: Image) -> None:
    """Draw long bent cables."""
    along = np.linspace(0, 1, 80)[:, None]
    for _ in range(int(rng.integers(3, 12))):
        ends = rng.uniform((-200, -200), (SIZE_PX[0] + 200, SIZE_PX[1] + 200), (4, 2))
        shares = (1 - along) ** 3, 3 * along * (1 - along) ** 2, 3 * along**2 * (1 - along), along**3
        path = np.rint(np.add.reduce([share * end for share, end in zip(shares, ends, strict=True)]))
        cv2.polylines(
            image, [path.astype(np.int32)], False, color(rng), int(rng.integers(3, 30)), cv2.LINE_AA
        )


def draw_clutter(rng: Rng, image: Image) -> None:
    """Draw polygons, ellipses and rods."""
    for _ in range(int(rng.integers(20, 60))):
        kind, shade = rng.integers(3), color(rng)
        if kind == 0:
            corners = np.array(point(rng)) + rng.integers(-120, 120, (int(rng.integers(3, 7)), 2))
            cv2.fillPoly(image, [corners.astype(np.int32)], shade, cv2.LINE_AA)
        elif kind == 1:
            axes = tuple(map(int, rng.integers(5, 140, 2)))
            cv2.ellipse(image, point(rng), axes, rng.uniform(0, 180), 0, 360, shade, cv2.FILLED, cv2.LINE_AA)
        else:
            cv2.line(image, point(rng), point(rng), shade, int(rng.integers(2, 40)), cv2.LINE_AA)


def draw_texture(rng: Rng, image: Image) -> None:
    """Draw grain of all sizes, longer one way."""
    total = np.zeros(SIZE_PX[::-1], np.float32)
    for size in (2, 5, 12, 40):
        grain = rng.standard_normal(total.shape, np.float32)
        soft = cv2.GaussianBlur(grain, (0, 0), sigmaX=size * rng.uniform(0.5, 6), sigmaY=size)
        total += soft / soft.std()
    image[:] = np.clip(image + rng.uniform(5, 25) * total[..., None], 0, 255)


def draw_fundus(rng: Rng, image: Image) -> None:
    """Draw a retina from the front, with branching vessels."""
    middle, radius_px = (640, int(rng.integers(340, 420))), int(rng.integers(200, 420))
    image[:] = (12, 10, 14)
    cv2.circle(image, middle, radius_px, (40, 80, int(rng.integers(150, 220))), cv2.FILLED, cv2.LINE_AA)
    for _ in range(int(rng.integers(6, 14))):
        place, turn_rad, width = np.array(middle, float), rng.uniform(0, 2 * np.pi), rng.uniform(4, 12)
        for _ in range(60):
            turn_rad += rng.normal(0, 0.12)
            ahead = place + 9 * np.array([np.cos(turn_rad), np.sin(turn_rad)])
            ends = [tuple(map(int, each)) for each in (place, ahead)]
            cv2.line(image, *ends, (25, 35, 120), max(int(width), 1), cv2.LINE_AA)
            place, width = ahead, 0.97 * width


def draw_wood(rng: Rng, image: Image) -> None:
    """Draw long straight grain, and boards side by side."""
    angle_deg = rng.uniform(0, 180)
    grain = cv2.GaussianBlur(rng.standard_normal((1600, 1600), np.float32), (0, 0), sigmaX=120, sigmaY=1.5)
    boards = np.sign(np.sin(np.arange(1600) * np.pi / rng.uniform(60, 200)))[:, None]
    turned = cv2.warpAffine(
        grain / grain.std() * rng.uniform(5, 20) + 15 * boards.astype(np.float32),
        cv2.getRotationMatrix2D((800, 800), angle_deg, 1.0),
        (1600, 1600),
        borderMode=cv2.BORDER_REFLECT,
    )
    image[:] = np.clip(image + turned[440:1160, 160:1440, None], 0, 255)


def draw_tray(rng: Rng, image: Image) -> None:
    """Draw instruments on a tray: long bright tapering rods with a highlight, anywhere."""
    for _ in range(int(rng.integers(2, 9))):
        one, other, width = point(rng), point(rng), int(rng.integers(5, 22))
        shade = rng.uniform(60, 220)
        cv2.line(image, one, other, [shade] * 3, width, cv2.LINE_AA)
        cv2.line(image, one, other, [min(1.3 * shade, 255)] * 3, max(width // 4, 1), cv2.LINE_AA)


KINDS: dict[str, Callable[[Rng], tuple[Image, str]]] = {
    "light eye": lambda rng: empty_eye(rng, "light"),
    "dark eye": lambda rng: empty_eye(rng, "dark"),
    "clutter eye": lambda rng: empty_eye(rng, "clutter"),
    "moved eye": moved_eye,
    "plain": usual(draw_nothing),
    "grating": usual(draw_grating),
    "text": usual(draw_text),
    "cables": usual(draw_cables),
    "clutter": usual(draw_clutter),
    "texture": usual(draw_texture),
    "fundus": usual(draw_fundus),
    "wood": usual(draw_wood),
    "tray": usual(draw_tray),
}


if __name__ == "__main__":
    main()
