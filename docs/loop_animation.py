"""Draw docs/images/loop.gif: image, scene graph, state and haptic output of a simulated run.

python docs/loop_animation.py [RECORDING]
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

import haptigraph
from haptigraph.analysis.plots.drawing import (
    ANATOMY_COLORS,
    CONE_COLOR,
    INSTRUMENT_COLOR,
    draw_overlay,
    grey_norm,
)
from haptigraph.analysis.plots.series import read_series
from haptigraph.messages import Step
from haptigraph.perception.eye_view import view_of
from haptigraph.registration.loading import parse_registration

OUTPUT = Path(__file__).parent / "images" / "loop.gif"
SIZE_PX, DPI, RATE_HZ, COLORS = (900, 506), 100, 12.5, 128
GROUND, PANEL, LINE, TEXT, QUIET = "#0e1317", "#161d23", "#2c3740", "#e8edf1", "#9aabb8"
"""As on the live page."""
PACE = ((0.3, 0.0), (1.0, 1.8), (1.1, 2.3), (2.0, 5.8), (3.2, 8.6), (5.0, 10.8), (6.2, 14.5), (7.2, 18.8),
        (7.9, 20.7), (9.6, 22.9))  # fmt: skip
"""Seconds of the animation and of the run: it hurries where nothing changes."""
PAST_S = 6.0
"""How much of the haptic output is shown."""
HOLD_S = 1.2
"""How long a short pattern stays named."""
SAME_GREY = 9
"""A pixel that changes less stays as it is: noise would make the file large."""
FEELS = {"off": "silence", "low": "low vibration", "pulse": "rapid pulses", "success": "double burst"}


def main() -> None:
    """Record a run, draw it, and write the animation."""
    with TemporaryDirectory() as folder:
        path = Path(sys.argv[1]) if sys.argv[1:] else record(Path(folder) / "run.mcap")
        with haptigraph.RunReader(path) as run:
            pictures = Pictures(run)
            frames, patches = [Image.fromarray(frame) for frame in pictures.draw()], pictures.patches()
    palette = Image.fromarray(np.vstack([*(np.asarray(frame) for frame in frames[::12]), patches])).quantize(
        COLORS
    )
    small = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    small[0].save(OUTPUT, save_all=True, append_images=small[1:], duration=round(1000 / RATE_HZ), loop=0)
    print(f"{OUTPUT}: {len(small)} images, {OUTPUT.stat().st_size / 1e6:.2f} MB")


def record(path: Path) -> Path:
    """Record a needle that touches the retina beside the target, and then the target."""
    settings = ["source.uri=phantom:wrong_place_then_hit", "run.realtime=false", f"recording.path={path}"]
    haptigraph.build(haptigraph.load_config(settings=settings)).run()
    return path


class Pictures:
    """The pictures of a run."""

    def __init__(self, run: haptigraph.RunReader) -> None:
        self.run, self.series = run, read_series(run)
        self.registration = parse_registration(run.info.registration, "the run's registration")
        self.view, self.cone_deg = view_of(self.registration, 440), self.series.bounds("theta_deg")
        self.fine_s, self.amplitude = map(np.array, self.series.amplitudes())

    def draw(self) -> Iterator[np.ndarray]:
        """Yield the pictures, (height, width, 3) RGB."""
        moments = np.interp(np.arange(0, PACE[-1][0], 1 / RATE_HZ), *zip(*PACE, strict=True))
        numbers = np.searchsorted(self.series.time_s, moments, "right") - 1
        images = [capture.image for capture, _ in self.run.records()]
        steps = [self.series.steps[number] for number in numbers]
        eyes = steadied([self.view(images[number], {}) for number in numbers])
        norm = grey_norm(eyes[::20])
        for eye, step, time_s in zip(eyes, steps, moments, strict=True):
            yield self.picture(norm(eye), step, time_s)

    def patches(self) -> np.ndarray:
        """Return patches of the colours that must not be lost among the greys."""
        states = {step.conclusion.state for step in self.series.steps}
        colors = [CONE_COLOR, INSTRUMENT_COLOR, ANATOMY_COLORS[0], *map(self.series.color, sorted(states))]
        row = np.repeat([np.round(255 * np.array(to_rgb(color))) for color in colors], 60, axis=0)[
            : SIZE_PX[0]
        ]
        row = np.pad(row, ((0, SIZE_PX[0] - len(row)), (0, 0)))
        return np.repeat(row[None].astype(np.uint8), 200, axis=0)

    def picture(self, eye: np.ndarray, step: Step, time_s: float) -> np.ndarray:
        """Return one picture."""
        figure = Figure(figsize=(SIZE_PX[0] / DPI, SIZE_PX[1] / DPI), dpi=DPI, facecolor=GROUND)
        canvas = FigureCanvasAgg(figure)
        place = figure.add_axes(share(16, 50, 440, 440))
        place.imshow(eye, cmap="gray", vmin=0, vmax=1)
        draw_overlay(place, self.view, step, self.registration, self.cone_deg)
        for line in place.lines:
            line.set(linewidth=2 * line.get_linewidth(), markersize=1.6 * line.get_markersize())
        target = self.view.to_px(self.registration.target.at_mm)
        label = {"textcoords": "offset points", "fontsize": 12}
        place.annotate("target", target, (13, -5), color=ANATOMY_COLORS[0], **label)
        place.annotate("simulated", (437, 4), (-4, -10), ha="right", color=QUIET, **label)
        for left, top, text in (
            (16, 34, "image"),
            (480, 34, "scene graph"),
            (480, 222, "state"),
            (480, 340, "touch"),
        ):
            figure.text(left / SIZE_PX[0], 1 - top / SIZE_PX[1], text, color=QUIET, fontsize=15)
        self.graph(figure, step)
        self.state(figure, step)
        self.touch(figure, step, time_s)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    def graph(self, figure: Figure, step: Step) -> None:
        """Write the triplets; those that decided the state are bright."""
        decisive = {str(one) for one in step.conclusion.evidence}
        for row, edge in enumerate(step.graph.edges[:4]):
            is_decisive = str(edge) in decisive
            for left, text in ((480, edge.subject), (605, edge.predicate), (741, edge.object)):
                place = left / SIZE_PX[0], 1 - (72 + 36 * row) / SIZE_PX[1]
                weight = {"color": TEXT, "fontweight": "bold"} if is_decisive else {"color": QUIET}
                figure.text(*place, text.replace("_", " "), fontsize=12.5, **weight)

    def state(self, figure: Figure, step: Step) -> None:
        """Show the state in its colour."""
        name = step.conclusion.state
        place = figure.add_axes(share(480, 236, 404, 62), facecolor=self.series.color(name))
        place.set(xticks=[], yticks=[])
        place.spines[:].set_visible(False)
        place.text(
            0.5,
            0.46,
            name.replace("_", " "),
            color=self.series.ink(name),
            fontsize=17,
            fontweight="bold",
            ha="center",
            va="center",
        )

    def touch(self, figure: Figure, step: Step, time_s: float) -> None:
        """Plot the haptic output of the last seconds, up to now."""
        recent = [
            one.command.pattern.name
            for one, at_s in zip(self.series.steps, self.series.time_s, strict=True)
            if time_s - HOLD_S < at_s <= time_s
        ]
        feels = FEELS["success" if "success" in recent else step.command.pattern.name]
        figure.text(
            884 / SIZE_PX[0],
            1 - 340 / SIZE_PX[1],
            feels,
            color=TEXT,
            fontsize=17,
            fontweight="bold",
            ha="right",
        )
        place = figure.add_axes(share(480, 354, 404, 136), facecolor=PANEL)
        edges = time_s - PAST_S + PAST_S * np.arange(0, 404) / 404
        level = self.amplitude[np.clip(np.searchsorted(self.fine_s, edges, "right") - 1, 0, None)]
        level[edges < 0] = 0
        states = np.array([one.conclusion.state for one in self.series.steps])
        now = states[np.clip(np.searchsorted(self.series.time_s, edges, "right") - 1, 0, None)]
        for name in dict.fromkeys(now):
            place.fill_between(
                edges,
                np.where(now == name, level, 0),
                step="post",
                color=self.series.color(name),
                linewidth=0,
            )
        place.set(xlim=(edges[0], time_s), ylim=(0, 1.06), xticks=[], yticks=[])
        place.spines[:].set_color(LINE)


def steadied(pictures: list[np.ndarray]) -> list[np.ndarray]:
    """Return pictures without the noise of the camera."""
    shown = [cv2.GaussianBlur(pictures[0], (0, 0), 1.0)]
    for picture in pictures[1:]:
        smooth = cv2.GaussianBlur(picture, (0, 0), 1.0)
        shown.append(np.where(cv2.absdiff(smooth, shown[-1]) > SAME_GREY, smooth, shown[-1]))
    return shown


def share(left: float, top: float, width: float, height: float) -> tuple[float, float, float, float]:
    """Turn a box in pixels into shares of the picture, as Matplotlib counts."""
    return left / SIZE_PX[0], 1 - (top + height) / SIZE_PX[1], width / SIZE_PX[0], height / SIZE_PX[1]


if __name__ == "__main__":
    main()
