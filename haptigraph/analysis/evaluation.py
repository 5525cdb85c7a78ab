"""Score perception and states against the truth of a labelled clip.

A clip is a folder with clip.mp4, registration.toml and truth.csv; docs/conventions.md describes them and
defines every figure. Knows the perceiver only by its steps.
"""

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from haptigraph import assemble
from haptigraph.clock import VirtualClock
from haptigraph.config import Config
from haptigraph.errors import BadInput, EndOfSource, unknown_name
from haptigraph.geometry import ImageGeometry, Point, Vec
from haptigraph.messages import UNKNOWN, Step
from haptigraph.perception.registration import load_registration
from haptigraph.recording.writer import Progress

__all__ = ["Evaluation", "TruthRow", "evaluate_clip", "lag_images", "load_truth", "score"]

LEAST_DEPTH_MM = 2.0
SHALLOW_MM = (1.0, 3.0)
WALL_MM = 2.0  # a tip that vanishes this close to the pivot is in the wall
CONTACT, HIT = "retinal_contact", "target_hit"


class TruthRow(Struct, frozen=True):
    """The truth of one image; numbers are None where the tip cannot be seen."""

    visible: bool
    inside: bool
    tip_px: Vec | None
    depth_mm: float | None
    theta_deg: float | None
    state: str


class Evaluation(Struct, frozen=True):
    """The scores of one clip."""

    scores: dict[str, Any]
    """As `score` returns them, with "clip" and "perceiver" in front."""
    lag_images: float | None
    """How many images the reported tip lags behind the true one."""


def evaluate_clip(folder: str | Path, config: Config, progress: Progress | None = None) -> Evaluation:
    """Run a labelled clip through a pipeline and score it.

    Args:
        folder: The clip.
        config: Chooses perceiver and procedure.
        progress: Told how far it is.

    Raises:
        BadInput: If a file is missing or makes no sense.
    """
    folder = Path(folder)
    registration = load_registration(folder / "registration.toml")
    procedure = assemble.load_procedure(config.run.procedure)
    truth = load_truth(folder / "truth.csv", [state.name for state in procedure.states])
    pipeline = assemble.build_pipeline(config, registration, procedure)
    source = assemble.open_source(_with_source(config, folder / "clip.mp4"), VirtualClock())
    steps = []
    try:
        while True:
            capture = source.read(1.0)
            if capture is not None and capture.image is not None:
                steps.append(pipeline.step(capture))
                if progress is not None:
                    progress("evaluating", len(steps), len(truth))
    except EndOfSource:
        pass
    except BadInput as error:
        raise BadInput(error.problem, error.file or folder / "clip.mp4", error.place) from None
    finally:
        source.close()
    if len(steps) != len(truth):
        raise BadInput(f"has {len(truth)} rows, but the clip has {len(steps)} images", folder / "truth.csv")
    named = {"clip": folder.resolve().name, "perceiver": config.perception.perceiver}
    scores = score(steps, truth, registration.image)
    return Evaluation({**named, **scores}, lag_images(steps, truth, registration.image))


def load_truth(path: Path, states: Sequence[str] = ()) -> list[TruthRow]:
    """Read a truth.csv.

    Args:
        path: The file.
        states: The states there are; none: any.

    Raises:
        BadInput: If it cannot be read or a row makes no sense.
    """
    rows = []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            for row in csv.DictReader(file, strict=True):
                rows.append(_truth_row(row, states))
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", path) from None
    except UnicodeDecodeError:
        raise BadInput("not UTF-8 text", path) from None
    except KeyError as error:
        raise BadInput(f"column {error} is missing", path) from None
    except (ValueError, csv.Error) as error:
        raise BadInput(str(error), path, f"line {len(rows) + 2}") from None
    return rows


def score(steps: Sequence[Step], truth: Sequence[TruthRow], image: ImageGeometry) -> dict[str, Any]:
    """Score steps against the truth, image by image.

    Returns:
        detection_rate, false_detections, tip_error_px, tip_error_mm, angle_error_deg, state_agreement,
        wrong_contact_images, state_changes, final_state.
    """
    tips = [_tip_px(step, image) for step in steps]
    hidden = _hidden_in_wall(truth)
    errors = [
        _miss(tip, row.tip_px) for tip, row in zip(tips, truth, strict=True) if row.visible and row.inside
    ]
    errors_px = np.array([error for error in errors if error is not None])
    deep = [row for row in range(len(truth)) if _depth(truth[row]) > SHALLOW_MM[1]]
    shallow = [row for row in range(len(truth)) if SHALLOW_MM[0] <= _depth(truth[row]) <= SHALLOW_MM[1]]
    expected = [tips[row] is not None for row in range(len(truth)) if _depth(truth[row]) >= LEAST_DEPTH_MM]
    states, true_states = [step.conclusion.state for step in steps], [row.state for row in truth]
    return {
        "images": len(truth),
        "detection_rate": _share(expected),
        "false_detections": sum(
            tip is not None and not row.visible and not row.inside and not in_wall
            for tip, row, in_wall in zip(tips, truth, hidden, strict=True)
        ),
        "tip_error_px": _spread(errors_px),
        "tip_error_mm": _spread(errors_px * image.mm_per_px),
        "angle_error_deg": {
            "shallow": _spread(_angle_errors(steps, truth, shallow)),
            "deep": _spread(_angle_errors(steps, truth, deep)),
        },
        "state_agreement": _agreement(states, true_states, hidden),
        "wrong_contact_images": _wrong_contacts(states, true_states),
        "state_changes": {"run": _changes(states), "truth": _changes(true_states)},
        "final_state": states[-1] if states else UNKNOWN,
    }


def lag_images(steps: Sequence[Step], truth: Sequence[TruthRow], image: ImageGeometry) -> float | None:
    """Estimate the lag of the reported tip in images: least squares of its error on the true motion."""
    against, motion = 0.0, 0.0
    for row in range(1, len(truth)):
        before, now, tip = truth[row - 1].tip_px, truth[row].tip_px, _tip_px(steps[row], image)
        if before and now and tip and truth[row].inside:
            moved = now[0] - before[0], now[1] - before[1]
            against -= (tip[0] - now[0]) * moved[0] + (tip[1] - now[1]) * moved[1]
            motion += moved[0] ** 2 + moved[1] ** 2
    return against / motion if motion > 0 else None


def _with_source(config: Config, clip: Path) -> Config:
    return replace(config, source=replace(config.source, uri=str(clip), loop=False))


def _truth_row(row: dict[str, str], states: Sequence[str]) -> TruthRow:
    """Read one row.

    Raises:
        ValueError: If it makes no sense.
        KeyError: If a column is missing.
    """
    if None in row or None in row.values():  # as csv tells of it
        raise ValueError(f"{'more' if None in row else 'fewer'} values than there are columns")
    if states and row["state"] not in states:
        raise ValueError(unknown_name("state", row["state"], states))

    def flag(name: str) -> bool:
        if row[name] not in ("0", "1"):
            raise ValueError(f"{name}: expected 0 or 1, found {row[name]!r}")
        return row[name] == "1"

    def number(name: str) -> float | None:
        try:
            value = float(row[name]) if row[name] else None
        except ValueError:
            value = math.nan
        if value is not None and not math.isfinite(value):
            raise ValueError(f"{name}: not a finite number: {row[name]!r}")
        return value

    x, y = number("tip_x_px"), number("tip_y_px")
    return TruthRow(
        visible=flag("visible"),
        inside=flag("inside"),
        tip_px=(x, y) if x is not None and y is not None else None,
        depth_mm=number("depth_mm"),
        theta_deg=number("theta_deg"),
        state=row["state"],
    )


def _tip_px(step: Step, image: ImageGeometry) -> Vec | None:
    tip = step.observation.found.get("needle_tip")
    return image.to_px(tip.at_mm) if isinstance(tip, Point) else None


def _depth(row: TruthRow) -> float:
    """Return the depth of a visible tip inside the eye; -inf for any other."""
    return row.depth_mm if row.visible and row.inside and row.depth_mm is not None else -math.inf


def _miss(tip: Vec | None, true_tip: Vec | None) -> float | None:
    return math.dist(tip, true_tip) if tip and true_tip else None


def _angle_errors(steps: Sequence[Step], truth: Sequence[TruthRow], rows: list[int]) -> NDArray[np.float64]:
    errors = []
    for row in rows:
        theta_deg, true_deg = steps[row].graph.measures.get("theta_deg"), truth[row].theta_deg
        if theta_deg is not None and true_deg is not None:
            errors.append(abs(theta_deg - true_deg))
    return np.array(errors)


def _hidden_in_wall(truth: Sequence[TruthRow]) -> list[bool]:
    """Mark unseen images whose neighbours in time show the tip at the wall: it is passing through."""
    hidden = [False] * len(truth)
    row = 0
    while row < len(truth):
        end = row
        while end < len(truth) and not truth[end].visible:
            end += 1
        beside = [truth[other] for other in (row - 1, end) if 0 <= other < len(truth)]
        at_wall = any(abs(seen.depth_mm) <= WALL_MM for seen in beside if seen.depth_mm is not None)
        hidden[row:end] = [at_wall] * (end - row)
        row = end + 1
    return hidden


def _agreement(states: list[str], true_states: list[str], hidden: list[bool]) -> float | None:
    counted = [
        states[row] == true_states[row]
        for row in range(len(states))
        if not hidden[row] and len(set(true_states[max(row - 1, 0) : row + 2])) == 1
    ]
    return _share(counted)


def _wrong_contacts(states: list[str], true_states: list[str]) -> int:
    return sum(
        state == CONTACT and not {CONTACT, HIT} & set(true_states[max(row - 1, 0) : row + 2])
        for row, state in enumerate(states)
    )


def _changes(states: list[str]) -> int:
    return sum(states[row] != states[row - 1] for row in range(1, len(states)))


def _share(hits: list[bool]) -> float | None:
    return sum(hits) / len(hits) if hits else None


def _spread(errors: NDArray[np.float64]) -> dict[str, float | None]:
    if not len(errors):
        return {"median": None, "p95": None}
    return {"median": float(np.median(errors)), "p95": float(np.percentile(errors, 95))}
