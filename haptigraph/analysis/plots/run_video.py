"""Draw a recorded run as a video: state, picture with what was detected, and the haptic output below.

The strip below shows the commanded amplitude from some seconds before the picture to some seconds after it,
on the colours of the states.
"""

import math
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from haptigraph.analysis.plots.drawing import draw_overlay
from haptigraph.analysis.plots.paper import COLORS
from haptigraph.analysis.plots.series import Series, read_series
from haptigraph.analysis.plots.video_file import new_video
from haptigraph.errors import BadInput
from haptigraph.figures import Figure, FigureCanvasAgg, to_rgb
from haptigraph.messages import Capture, Step, reason
from haptigraph.perception.eye_view import view_of
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.registered import BaseRegistration

__all__ = ["run_video"]

Pixels: TypeAlias = NDArray[np.uint8]
Box: TypeAlias = tuple[int, int, int, int]
"""Left, top, width and height [px]."""
WIDTH_PX, HEIGHT_PX, HEADER_PX, DPI = 640, 864, 64, 100
VIEW: Box = (0, HEADER_PX, WIDTH_PX, WIDTH_PX)
STRIP: Box = (56, 728, 572, 96)
REACH_S = 4.0
"""How much of the haptic output is shown before and after now."""
MOST = 1.05
"""Top of the strip: the greatest amplitude is 1."""
NOTES = {"phantom": "SIMULATED: no person steered", "teleop": "simulated eye"}
NO_IMAGE = 60
FADED_SHARE = 0.45
"""Of the state's colour in the strip; the rest is white, so that the amplitude stands out."""
HATCH_PX = 6


def run_video(path: str | Path, output: str | Path, progress: Progress | None = None) -> str:
    """Write a video of a recorded run, in real time.

    Args:
        path: The recording.
        output: The MP4 file to write; it must not exist.
        progress: Called with the number of steps drawn.

    Returns:
        The name of the codec.

    Raises:
        BadInput: If the recording cannot be read, or the file exists, is no .mp4 or cannot be written.
        MissingExtra: If PyAV is not installed.
    """
    target, report = Path(output), progress or (lambda what, done, total: None)
    if target.suffix.lower() != ".mp4":
        raise BadInput("a video is written as MP4; its name ends in .mp4", target)
    if target.exists():
        raise BadInput("exists already; delete it or give another name", target)
    reader = RunReader(path)
    series = read_series(reader)
    registration = parse_registration(reader.info.registration, f"registration in {path}")
    note = NOTES.get(reader.info.source.partition(":")[0], "")
    with new_video(target, WIDTH_PX, HEIGHT_PX, reader.info.rate_hz) as video:
        pictures = _Pictures(series, registration, note)
        for number, (capture, step) in enumerate(reader.records()):
            report("drawing the video", number, len(series.steps))
            video.add(pictures.draw(capture, step, series.time_s[number]), series.time_s[number])
    return video.codec


class _Pictures:
    """Draw one picture after another; what stays the same is drawn once."""

    def __init__(self, series: Series, registration: BaseRegistration, note: str) -> None:
        self._series, self._registration = series, registration
        self._view = view_of(registration, WIDTH_PX)
        self._cone_deg = series.bounds("theta_deg")
        self._strip = _Strip(series)
        figure = Figure(figsize=(WIDTH_PX / DPI, HEIGHT_PX / DPI), dpi=DPI)
        self._canvas = cast("Any", FigureCanvasAgg(figure))  # its methods have no types
        self._axes = figure.add_axes(_share(VIEW))
        top = 1 - 0.5 * HEADER_PX / HEIGHT_PX
        self._state = figure.text(0.02, top, "", va="bottom", fontsize=13, fontweight="bold")
        self._reason = figure.text(0.02, top, "", va="top", fontsize=8)
        self._time = figure.text(0.98, top, "", va="bottom", ha="right", fontsize=13, family="monospace")
        self._missing = figure.text(0.5, 0.55, "no image", ha="center", fontsize=16, color="white")
        strip = figure.add_axes(_share(STRIP))
        strip.set(yticks=[0, 1], xlabel="time from now [s]", ylabel="amplitude")
        strip.set(xlim=(-REACH_S, REACH_S), ylim=(0, MOST))
        strip.set_title("commanded haptic output", loc="left", fontsize=9, pad=3)
        strip.set_title(note, loc="right", fontsize=9, pad=3, fontweight="bold")
        strip.tick_params(labelsize=8)
        self._overlay(max(series.steps, key=lambda step: len(step.observation.found)))
        self._legend = self._drawn_legend()
        for artist in (self._missing, self._state, self._reason, self._time, *self._axes.lines):
            artist.set_animated(True)
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(figure.bbox)

    def draw(self, capture: Capture, step: Step, time_s: float) -> Pixels:
        """Return the picture of one step, (height, width, 3) RGB."""
        state, image = step.conclusion.state, capture.image
        self._canvas.restore_region(self._background)
        pixels = self._pixels()
        pixels[:HEADER_PX] = _rgb(self._series.color(state))
        _part(pixels, VIEW)[:] = (
            NO_IMAGE if image is None else self._view(image, step.observation.found)[..., None]
        )
        _part(pixels, STRIP)[:] = self._strip.at(time_s)
        self._state.set_text(state.replace("_", " "))
        self._reason.set_text("; ".join([reason(capture, step), *(fault.message for fault in step.faults)]))
        self._time.set_text(f"{time_s:.2f} s")
        texts = [self._state, self._reason, self._time]
        for text in texts:
            text.set_color(self._series.ink(state))
        self._overlay(step)
        for artist in (*self._axes.lines, *texts, *([self._missing] if image is None else [])):
            self._canvas.figure.draw_artist(artist)
        height, width, _ = self._legend.shape
        _part(pixels, VIEW)[-height:, :width] = self._legend
        return pixels

    def _pixels(self) -> Pixels:
        """Return the canvas, to read and write."""
        return np.asarray(self._canvas.buffer_rgba())[..., :3]

    def _overlay(self, step: Step) -> None:
        for line in list(self._axes.lines):
            line.remove()
        draw_overlay(self._axes, self._view, step, self._registration, self._cone_deg)

    def _drawn_legend(self) -> Pixels:
        """Return the legend of the current overlay, from the lower left corner of the view."""
        style: dict[str, Any] = {"fontsize": 8, "labelcolor": "white", "facecolor": "black", "framealpha": 1}
        legend = self._axes.legend(loc="lower left", borderaxespad=0, fancybox=False, **style)
        self._canvas.draw()
        box = legend.get_window_extent()
        drawn = _part(self._pixels(), VIEW)[-math.ceil(box.height) :, : math.ceil(box.width)].copy()
        legend.remove()
        return drawn


class _Strip:
    """The haptic output about a moment, as pixels: one column a moment, on the colour of its state."""

    def __init__(self, series: Series) -> None:
        _, _, width, height = STRIP
        self._offsets_s = np.linspace(-REACH_S, REACH_S, width)
        self._levels = np.linspace(MOST, 0, height)[:, None]
        self._step_s = np.array(series.time_s)
        self._fine_s, self._amplitude = map(np.array, series.amplitudes())
        states, kinds = [step.conclusion.state for step in series.steps], series.procedure.kinds
        faded = {state: _rgb(series.color(state), FADED_SHARE) for state in set(states)}
        self._colors = np.array([faded[state] for state in states])
        self._is_unseen = np.array([kinds.get(state) == "unseen" for state in states])

    def at(self, time_s: float) -> Pixels:
        """Return the strip around a time, (height, width, 3) RGB; states without a needle are hatched."""
        times = time_s + self._offsets_s
        step = np.clip(np.searchsorted(self._step_s, times, "right") - 1, 0, None)
        fine = np.clip(np.searchsorted(self._fine_s, times, "right") - 1, 0, None)
        picture: Pixels = np.repeat(self._colors[step][None], len(self._levels), axis=0)
        row, column = np.indices(picture.shape[:2])
        moved = round(time_s * len(times) / (2 * REACH_S))  # the hatching stays with its state
        picture[((row + column + moved) % HATCH_PX == 0) & self._is_unseen[step]] = _rgb(COLORS["grey"])
        picture[self._levels < self._amplitude[fine]] = _rgb(COLORS["purple"])
        picture[:, (times < 0) | (times > self._step_s[-1])] = _rgb("white")
        middle = len(times) // 2
        picture[:, middle - 1 : middle + 1] = _rgb("black")
        return picture


def _rgb(color: str, share: float = 1.0) -> Pixels:
    """Return a colour, or a share of it mixed with white."""
    return np.array([round(255 * (1 - share * (1 - value))) for value in to_rgb(color)], np.uint8)


def _part(pixels: Pixels, box: Box) -> Pixels:
    left, top, width, height = box
    return pixels[top : top + height, left : left + width]


def _share(box: Box) -> tuple[float, float, float, float]:
    """Return a box in shares of the picture, from the lower left corner, as Matplotlib counts."""
    left, top, width, height = box
    return left / WIDTH_PX, 1 - (top + height) / HEIGHT_PX, width / WIDTH_PX, height / HEIGHT_PX
