"""Helpers for tests: messages, observations, images, the command line, interrupts, and copies of the sources."""

import gc
import hashlib
import math
import pickle
import re
import shutil
import sys
from collections.abc import Callable, Iterable
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import pytest
from click.testing import CliRunner
from paths import ROOT

from haptigraph.cli import main
from haptigraph.errors import EndOfSource
from haptigraph.geometry import Geometry, Phase, Point, Segment, Vec, rotate, subtract, unit
from haptigraph.graph import SceneGraph
from haptigraph.haptics.renderer import GrammarRenderer
from haptigraph.inference.engine import RuleEngine
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import (
    OFF,
    Capture,
    Certainty,
    Conclusion,
    Fault,
    HapticCommand,
    Observation,
    Pattern,
    Step,
)
from haptigraph.pipeline import Pipeline
from haptigraph.registration.camera import Registration
from haptigraph.scene.builder import SchemaSceneBuilder

MS = 1_000_000
LOW = Pattern("low", "continuous", amplitude=0.3, frequency_hz=80)
PULSE = Pattern("pulse", "pulses", amplitude=1.0, frequency_hz=160, on_ms=80, off_ms=80)
SUCCESS = Pattern("success", "bursts", amplitude=0.8, frequency_hz=160, on_ms=100, off_ms=100, count=2)


def mostly_slow(params: Iterable, *fast: object) -> list:
    """Return parameters of which `make test` takes those of some names, and `make test-slow` the others."""
    return [
        param if getattr(param, "name", param) in fast else pytest.param(param, marks=pytest.mark.slow)
        for param in params
    ]


def remembered(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that computes the same result only once for equal arguments."""
    found: dict[bytes, Any] = {}

    def result(*arguments: object, **options: object) -> Any:
        key = hashlib.sha256(pickle.dumps((arguments, options))).digest()  # images are large
        if key not in found:
            found[key] = function(*arguments, **options)
        return found[key]

    return result


def scenario_at(rate_hz: int, scenario: str, folder: Path) -> Path:
    """Write a scenario with another number of images a second into a folder."""
    path = folder / "scenario.toml"
    path.write_text(re.sub(r"(?m)^rate_hz = \d+$", f"rate_hz = {rate_hz}", Path(scenario).read_text()))
    return path


def needle(entry_mm: Vec, tip_mm: Vec) -> dict[str, Geometry]:
    return {"needle_tip": Point(tip_mm), "needle_line": Segment(entry_mm, tip_mm)}


def graph_on_target(procedure: Procedure, registration: Registration, phase: str | None) -> SceneGraph:
    """The graph of a needle whose tip is on the target, in a phase of the operation or none."""
    anatomy = registration.anatomy
    trocar, target = anatomy["trocar"], anatomy["retina_target"]
    assert isinstance(trocar, Point) and isinstance(target, Point)
    found = anatomy | needle(trocar.at_mm, target.at_mm) | ({phase: Phase(1.0)} if phase else {})
    return SchemaSceneBuilder(procedure.schema)(Observation(0, found))


def observe(
    anatomy: dict[str, Geometry], tip_mm: Vec | None, stamp_ns: int = 0, sd_mm: float | None = None
) -> Observation:
    """An observation with a needle from the trocar to a tip, or without a needle."""
    if tip_mm is None:
        return Observation(stamp_ns, anatomy)
    trocar = anatomy["trocar"]
    assert isinstance(trocar, Point)
    certainty = None if sd_mm is None else Certainty(1.0, sd_mm, 0.02)
    return Observation(stamp_ns, {**anatomy, **needle(trocar.at_mm, tip_mm)}, certainty=certainty)


def on_axis(anatomy: dict[str, Geometry], depth_mm: float, theta_deg: float = 0.0) -> Vec:
    """The tip of a needle at a depth from the trocar, at an angle to the target."""
    trocar, target = anatomy["trocar"], anatomy["retina_target"]
    assert isinstance(trocar, Point) and isinstance(target, Point)
    along = rotate(unit(subtract(target.at_mm, trocar.at_mm)), theta_deg)
    return trocar.at_mm[0] + depth_mm * along[0], trocar.at_mm[1] + depth_mm * along[1]


def draw_rod(image, center_px, rotation_rad, ends_px, width_px):
    """Draw a dark rod through a point; 0 is vertical, positive rotates its lower end to the right."""
    along = math.sin(rotation_rad), math.cos(rotation_rad)
    ends = [
        [round(16 * (at + end_px * step)) for at, step in zip(center_px, along, strict=True)]
        for end_px in ends_px
    ]
    cv2.line(image, *ends, (15, 15, 15), width_px, cv2.LINE_AA, shift=4)


def make_step(
    pattern: Pattern = OFF,
    *,
    stamp_ns: int = 0,
    since_ns: int | None = None,
    state: str = "some_state",
    faults: tuple[Fault, ...] = (),
) -> Step:
    """A step that commands a pattern."""
    return Step(
        index=0,
        stamp_ns=stamp_ns,
        observation=Observation(stamp_ns, {}, faults),
        graph=SceneGraph(stamp_ns),
        conclusion=Conclusion(stamp_ns, state, 1, pattern.name, "because"),
        command=HapticCommand(stamp_ns, pattern, stamp_ns if since_ns is None else since_ns),
    )


class ScriptedPerceiver:
    """Return or raise the items of a list, image by image: a tip, a shaft without tip, None, or an exception."""

    def __init__(self, registration: Registration, script: list[Vec | Segment | Exception | None]) -> None:
        self.anatomy, self.script, self.resets = registration.anatomy, list(script), 0

    def __call__(self, capture: Capture) -> Observation:
        item = self.script[capture.index % len(self.script)]
        if isinstance(item, Exception):
            raise item
        if isinstance(item, Segment):
            return Observation(capture.stamp_ns, {**self.anatomy, "needle_line": item})
        return observe(self.anatomy, item, capture.stamp_ns)

    def reset(self) -> None:
        self.resets += 1


def pipeline_of(procedure: Procedure, perceiver: ScriptedPerceiver) -> Pipeline:
    return Pipeline(
        perceive=perceiver,
        build_scene=SchemaSceneBuilder(procedure.schema),
        reason=RuleEngine(procedure),
        render=GrammarRenderer(procedure.patterns),
    )


def call(*arguments: str):
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def refuse(*arguments: str) -> str:
    result = call(*arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    return lines[0]


def drain(source, timeout_s: float = 1.0) -> list[Capture]:
    """All captures of a source, which is then closed."""
    captures = []
    try:
        while True:
            captures.append(source.read(timeout_s))
    except EndOfSource:
        source.close()
    return captures


def every_moment():
    """Yield functions that make a call and raise Ctrl-C at its first opcode, its second, ... until its end."""
    for moment in count():
        was_pressed = []
        yield partial(_press_ctrl_c, moment, was_pressed)
        if not was_pressed.pop():
            break
    assert moment > 5, "the call has hardly any opcode at which Ctrl-C could occur"


def _press_ctrl_c(moment, was_pressed, call):
    left, before = moment, sys.gettrace()

    def press(frame, _event, _argument):
        nonlocal left
        frame.f_trace_opcodes = True
        left -= 1
        if left < 0:
            sys.settrace(before)
            raise KeyboardInterrupt
        return press

    gc.disable()  # otherwise Ctrl-C could occur in a callback of the garbage collector
    sys.settrace(press)
    try:
        call()
        was_pressed.append(False)
    except KeyboardInterrupt:
        was_pressed.append(True)
    finally:
        sys.settrace(before)
        gc.enable()


def text_extents(text) -> tuple[float, float]:
    """Left and right end of a text of an SVG in DejaVu Sans [px]."""
    import matplotlib
    from PIL import ImageFont

    fonts = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    name = "DejaVuSans-Bold.ttf" if text.get("font-weight") == "bold" else "DejaVuSans.ttf"
    width = ImageFont.truetype(fonts / name, 100).getlength(text.text) * float(text.get("font-size")) / 100
    x = float(text.get("x"))
    return {"start": (x, x + width), "end": (x - width, x)}.get(
        text.get("text-anchor"), (x - width / 2, x + width / 2)
    )


def copy_sources(folder: Path) -> None:
    """Copy what the package is built from; the copy compiles without optimization, in a seventh of the time."""
    for name in ("pyproject.toml", "README.md", "LICENSE", ".gitignore"):
        shutil.copy(ROOT / name, folder)
    build = (ROOT / "hatch_build.py").read_text(encoding="utf-8")
    assert '"-O3"' in build
    (folder / "hatch_build.py").write_text(build.replace('"-O3"', '"-O0"'), encoding="utf-8")
    ignored = shutil.ignore_patterns("__pycache__", "*.library")
    shutil.copytree(ROOT / "haptigraph", folder / "haptigraph", ignore=ignored)
