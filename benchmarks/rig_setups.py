"""Simulated rigs, sound and sabotaged, for checking them: images, registration and rig.toml of each.

Used by `rig_check.py` and the tests of `rig check`. Deterministic: one number and seed, one set-up.
"""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.analysis.rig_check.clip import clip_of
from haptigraph.analysis.rig_check.judging import Judgement, judge
from haptigraph.assemble import open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import Config, SourceConfig
from haptigraph.imaging import colored
from haptigraph.messages import Capture, Image
from haptigraph.registration.background import BackgroundImage
from haptigraph.registration.camera import Registration, anatomy_px
from haptigraph.registration.loading import load_camera_registration, parse_camera_registration
from haptigraph.registration.retarget import with_target
from haptigraph.registration.text import registration_text
from haptigraph.rig.description import Mirror, Rig, RigCamera, RigEye
from haptigraph.sim.eye.eye import RegistrationError
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenes import NUISANCE_CONDITIONS, random_scene
from haptigraph.sources.reading import read_images

__all__ = ["SABOTAGES", "SOUND", "Setup", "clip_setup", "judged", "simulated_setup", "warped"]

SOUND = ("plain", "shadow", "bubbles", "second_instrument", "tilt")
"""Nuisance conditions of the simulator that do not make a rig unsound."""
SIZE_PX = 640, 360
RATE_HZ = 30.0
STAMP_SD_S = 0.0005
NOISE_GREY = 1.5  # of a sensor, added where a change of the image has removed it
MARK_MM = 1.4
REGISTERED_SD_PX = 0.4
PATH_MM = 84.0
FOCAL_SD = 0.012  # of the rig's prediction; rig.toml states 1.5 %

Rng = np.random.Generator


class Setup(Struct, frozen=True, eq=False):
    """One rig as it stands."""

    images: tuple[Image, ...]
    stamps_ns: tuple[int, ...]
    registration: Registration
    rig: Rig | None

    @property
    def px_per_mm(self) -> float:
        """Registered scale."""
        return 1 / self.registration.image.mm_per_px

    def without_rig(self) -> "Setup":
        """Return the same set-up without rig.toml."""
        return replace(self, rig=None)


def judged(setup: Setup) -> Judgement:
    """Check a rig."""
    pairs = zip(setup.images, setup.stamps_ns, strict=True)
    captures = [Capture(number, stamp_ns, image) for number, (image, stamp_ns) in enumerate(pairs)]
    return judge(clip_of(captures, setup.registration, RATE_HZ), setup.registration, setup.rig)


def simulated_setup(
    number: int,
    seed: int,
    *,
    nuisance: str | None = None,
    has_mark: bool | None = None,
    has_reference: bool | None = None,
    size_px: tuple[int, int] = SIZE_PX,
) -> Setup:
    """Draw a rig that is set up well.

    Args:
        number: Number of the set-up.
        seed: Seed of all set-ups.
        nuisance: Nuisance condition of the scene; None: one of `SOUND`, in turn.
        has_mark: Whether the target is marked on the retina; None: drawn.
        has_reference: Whether the registration has a reference image without instrument; None: drawn.
        size_px: (width, height) of the images.
    """
    rng = np.random.default_rng((seed, 21, number))
    nuisance = nuisance or SOUND[number % len(SOUND)]
    scene_number = NUISANCE_CONDITIONS.index(nuisance) + len(NUISANCE_CONDITIONS) * number
    scenario = random_scene(scene_number, seed, size_px=size_px).scenario
    marked = rng.random() < 0.5 if has_mark is None else has_mark
    eye = replace(scenario.eye, target_deg=float(rng.choice((-1, 1)) * rng.uniform(6, 15)), rim_mm=0.6)
    if marked:
        eye = replace(eye, hemorrhage_mm=MARK_MM, hemorrhage_deg=eye.target_deg)
    error = RegistrationError(*((float(x), float(y)) for x, y in rng.normal(0, REGISTERED_SD_PX, (3, 2))))
    camera = replace(scenario.camera, distance_mm=PATH_MM)
    phantom = Phantom(
        replace(
            scenario,
            eye=eye,
            camera=camera,
            registration_error=replace(scenario.registration_error) if nuisance == "registration" else error,
        )
    )
    images = []
    while (moment := phantom.advance()) is not None:
        images.append(moment.image)
    registration = parse_camera_registration(phantom.registration, "registration")
    if rng.random() < 0.5 if has_reference is None else has_reference:
        empty = phantom.camera.render((0.0, 200.0), (0.0, -1.0), 9999)
        registration = _with_background(registration, empty)
    return Setup(
        tuple(images),
        _stamps_ns(len(images), rng),
        registration,
        rig_of(registration, float(np.exp(rng.normal(0, FOCAL_SD)))),
    )


def clip_setup(folder: Path) -> Setup:
    """Return the rig of a labelled clip, with a rig.toml that fits it."""
    registration = load_camera_registration(folder / "registration.toml")
    source = open_source(Config(SourceConfig(uri=str(folder / "clip.mp4"))), VirtualClock())
    captures = [capture for capture in read_images(source) if capture.index < 150]
    images = tuple(capture.image for capture in captures if capture.image is not None)
    return Setup(
        images, tuple(capture.stamp_ns for capture in captures), registration, rig_of(registration, 1.0)
    )


def rig_of(registration: Registration, focal_share: float) -> Rig:
    """Return a rig that predicts a registration, but for the share by which its focal length is off."""
    focal_px = PATH_MM / registration.image.mm_per_px * focal_share
    target_mm, trocar_mm = registration.target.at_mm, registration.trocar.at_mm
    trocar_deg = math.degrees(math.atan2(trocar_mm[0], trocar_mm[1]))
    camera = RigCamera(
        model="simulated camera",
        source="drawn",
        width_px=registration.width_px,
        height_px=registration.height_px,
        horizontal_fov_deg=math.degrees(2 * math.atan(registration.width_px / 2 / focal_px)),
        pixel_um=3.0,
        f_number=2.0,
        focus_mm=PATH_MM,
        nearest_mm=60.0,
        body_mm=(30.0, 30.0, 20.0),
        pupil_mm=4.0,
    )
    is_mirrored = registration.image.mirrored
    mirrors = (Mirror(from_section_mm=35.0, to_camera_mm=PATH_MM - 39.0),) if is_mirrored else ()
    return Rig(
        format=1,
        name="simulated",
        camera=camera,
        mirrors=mirrors,
        direct_mm=None if is_mirrored else PATH_MM - 4.0,
        eye=RigEye(
            diameter_mm=2 * registration.globe.radius_mm,
            target_deg=math.degrees(math.atan2(target_mm[0], -target_mm[1])),
            trocars_deg=(trocar_deg, -trocar_deg),
        ),
    )


def out_of_focus(setup: Setup, severity: int, rng: Rng) -> Setup:
    """Blur every image."""
    blur_px = (0.25, 0.4, 0.7)[severity] * setup.px_per_mm
    return _changed(setup, lambda image: _noisy(cv2.GaussianBlur(image, (0, 0), blur_px), rng))


def dim(setup: Setup, severity: int, rng: Rng) -> Setup:
    """Take light away."""
    gain = (85, 55, 25)[severity] / float(np.percentile(setup.images[0], 99))
    return _changed(setup, lambda image: _noisy(image * gain, rng))


def upside_down(setup: Setup, severity: int, rng: Rng) -> Setup:
    """Turn the camera by 180 degrees; a little less exactly, or mirrored as well, with the severity."""
    turned = _changed(setup, lambda image: np.ascontiguousarray(image[::-1, ::-1]))
    if severity == 0:
        return warped(turned, turn_deg=float(rng.uniform(-2, 2)))
    return turned if severity == 1 else _changed(turned, lambda image: np.ascontiguousarray(image[:, ::-1]))


def wrong_mirror_flag(setup: Setup, severity: int, rng: Rng) -> Setup:
    """State the opposite in the registration, or exchange left and right in the picture afterwards."""
    if severity == 2:
        return _changed(setup, lambda image: np.ascontiguousarray(image[:, ::-1]))
    data = anatomy_px(setup.registration)
    changed = replace(data, mirrored=not data.mirrored)
    if severity == 1:  # with names of trocars, as `register` writes them
        center_x = data.center_px[0]
        sides = ["right" if (t.point_px[0] > center_x) != data.mirrored else "left" for t in data.trocars]
        named = tuple(replace(t, name=side) for t, side in zip(data.trocars, sides, strict=True))
        changed = replace(changed, trocars=named)
    return replace(setup, registration=_parsed(registration_text(changed, "Sabotaged.")))


def camera_near(setup: Setup, severity: int, rng: Rng) -> Setup:
    """Move the camera towards the eye."""
    return warped(setup, zoom=(1.08, 1.25, 1.6)[severity])


def target_off(setup: Setup, severity: int, rng: Rng) -> Setup:
    """Register another target than the marked one."""
    target_mm, radius_mm = setup.registration.target.at_mm, setup.registration.globe.radius_mm
    along_mm = math.atan2(target_mm[0], -target_mm[1]) * radius_mm
    off_mm = (0.9, 2.0, 4.0)[severity] * float(rng.choice((-1, 1)))
    return replace(setup, registration=with_target(setup.registration, along_mm + off_mm))


def moved(setup: Setup, severity: int, rng: Rng) -> Setup:
    """Shift the picture, and turn it with the severity."""
    reach_px = (0.35, 0.7, 1.2)[severity] * setup.px_per_mm
    turn, turn_deg = rng.uniform(0, 2 * math.pi), (0.0, 2.5, 6.0)[severity] * float(rng.choice((-1, 1)))
    return warped(setup, shift_px=(reach_px * math.cos(turn), reach_px * math.sin(turn)), turn_deg=turn_deg)


def low_frame_rate(setup: Setup, severity: int, rng: Rng) -> Setup:
    """Deliver fewer images."""
    rate_hz = (20.0, 15.0, 7.5)[severity]
    stamps_ns = tuple(round(number * 1e9 / rate_hz) for number in range(len(setup.images)))
    return replace(setup, stamps_ns=stamps_ns)


def glare_on_port(setup: Setup, severity: int, rng: Rng) -> Setup:
    """Reflect a lamp in the port opening in use."""
    image, trocar_mm = setup.registration.image, setup.registration.trocar.at_mm
    share = (setup.registration.globe.radius_mm - 0.4) / math.hypot(*trocar_mm)
    x, y = image.to_px((trocar_mm[0] * share, trocar_mm[1] * share))
    radius_px = (0.3, 0.6, 1.0)[severity] * setup.px_per_mm
    height, width = setup.images[0].shape[:2]
    rows, columns = np.ogrid[:height, :width]
    away_px = np.hypot(columns - x, rows - y) - radius_px
    light = 300 * np.exp(-0.5 * (np.clip(away_px, 0, None) / (0.3 * radius_px)) ** 2)
    return _changed(setup, lambda each: each + light[..., None])


def wrong_scale(setup: Setup, severity: int, rng: Rng) -> Setup:
    """Register with another diameter than the eye's."""
    factor = (1.08, 1.16, 1.3)[severity] ** float(rng.choice((-1, 1)))
    data = anatomy_px(setup.registration)
    changed = replace(data, diameter_mm=round(data.diameter_mm * factor, 2))
    return replace(setup, registration=_parsed(registration_text(changed, "Sabotaged.")))


SABOTAGES: dict[str, tuple[Callable[[Setup, int, Rng], Setup], str]] = {
    "out of focus": (out_of_focus, "focus"),
    "dim": (dim, "dim"),
    "upside down": (upside_down, "upside_down"),
    "wrong mirror flag": (wrong_mirror_flag, "mirror"),
    "camera too near": (camera_near, "camera_near"),
    "target off": (target_off, "target_off"),
    "moved since registration": (moved, "moved"),
    "low frame rate": (low_frame_rate, "frame_rate"),
    "glare on the port": (glare_on_port, "glare"),
    "wrong scale": (wrong_scale, "scale"),
}
"""What is done to a sound set-up, at a severity from 0 to 2, and the name of the finding that must result."""


def _changed(setup: Setup, change: "Callable[[Image], np.ndarray]") -> Setup:
    images = (np.clip(np.rint(change(image)), 0, 255).astype(np.uint8) for image in setup.images)
    return replace(setup, images=tuple(images))


def _noisy(image: "np.ndarray", rng: Rng) -> "np.ndarray":
    return image + NOISE_GREY * rng.standard_normal((*image.shape[:2], 1), np.float32)


def warped(
    setup: Setup, *, zoom: float = 1.0, turn_deg: float = 0.0, shift_px: Sequence[float] = (0.0, 0.0)
) -> Setup:
    """Zoom and turn the pictures about the eye, clockwise, and shift them."""
    height, width = setup.images[0].shape[:2]
    matrix = cv2.getRotationMatrix2D(setup.registration.image.center_px, -turn_deg, zoom)
    matrix[:, 2] += shift_px
    return _changed(
        setup, lambda image: cv2.warpAffine(image, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE)
    )


def _with_background(registration: Registration, empty: Image) -> Registration:
    background = BackgroundImage(colored(empty), np.ones(empty.shape[:2], np.bool_))
    data = replace(anatomy_px(registration), background_webp=background.webp)
    return _parsed(registration_text(data, "With a reference image."))


def _parsed(text: str) -> Registration:
    return parse_camera_registration(text, "registration")


def _stamps_ns(count: int, rng: Rng) -> tuple[int, ...]:
    times_s = np.arange(count) / RATE_HZ + rng.normal(0, STAMP_SD_S, count)
    return tuple(round(1e9 * (float(time_s) + 1.0)) for time_s in times_s)
