"""Tables of a small SIMULATED study from a seeded generator: plausible numbers, neither people nor phantom.

Its effects are chosen by hand. It tests statistics and figures, and is no evidence about haptic feedback.
"""

import json
from pathlib import Path

import numpy as np
import pandas as pd

STATES = (
    *("misaligned_intraocular_navigation", "aligned_intraocular_navigation", "misaligned_retinal_approach"),
    *("aligned_retinal_approach", "retinal_contact", "target_hit", "unknown", "outside_eye"),
)
CONDITIONS = ("visual", "visual_haptic")
PROTOCOL = """
[[condition]]
name = "visual"
title = "Eyes"
touch = false

[[condition]]
name = "visual_haptic"
title = "Eyes & hands"
"""
ANALYSIS = """
[analysis]
primary = ["mean_theta_deg"]
alpha = 0.04
min_trials = 2
equivalence = { completion_s = [-10, 10] }

[[analysis.hypothesis]]
measure = "mean_theta_deg"
first = "visual"
second = "visual_haptic"
expect = "smaller"

[[analysis.hypothesis]]
measure = "sus"
first = "visual"
second = "visual_haptic"

[[analysis.hypothesis]]
measure = "completion_s"
first = "visual"
second = "visual_haptic"
expect = "equivalent"
"""


def simulated_study(
    participants: int = 16,
    seed: int = 7,
    conditions: tuple[str, ...] = CONDITIONS,
    trials: int = 3,
    within: bool = True,
) -> dict[str, pd.DataFrame]:
    """Return trials, answers and participants of a simulated study."""
    rng = np.random.default_rng(seed)
    rows, answers, people = [], [], []
    for number in range(1, participants + 1):
        name = f"S{number:02}"
        order = [conditions[(number + index) % len(conditions)] for index in range(len(conditions))]
        order = order if within else order[:1]
        people.append(dict(study="simulated study", participant=name, order=">".join(order), simulated=True))
        skill = rng.normal(0, 1)
        for position, condition in enumerate(order, 1):
            phases = [("training", 1), *(("trial", trial) for trial in range(1, trials + 1))]
            for phase, trial in phases:
                rows.append(_run(rng, name, condition, position, phase, trial, skill))
            answers += _sus(rng, name, condition, position)
    return {
        "trials": pd.DataFrame(rows),
        "answers": pd.DataFrame(answers),
        "participants": pd.DataFrame(people),
    }


def _run(rng, name, condition, position, phase, trial, skill):
    touch = condition.endswith("haptic")
    practice = 6 / (position + trial)
    total = float(80 + 10 * skill + 3 * practice + rng.normal(0, 12))
    theta = float(max(2.0, 7.0 - 1.1 * touch + skill + 0.25 * practice + rng.normal(0, 1.2)))
    shares = rng.dirichlet((6, 4, 3, 3) if touch else (8, 0.4, 5, 3))
    times = dict.fromkeys(STATES, 0.0) | dict(
        zip(STATES[:4], (float(share) * total for share in shares), strict=True)
    )
    mis, ali, mis_app, ali_app, contact = STATES[:5]
    early = [mis, ali, ali_app] if touch else [mis, mis_app, ali_app]
    wobble = [mis_app, ali_app] * int(rng.integers(0, 3))
    slip = [contact, mis_app, ali_app] if rng.random() < 0.08 else []
    times[contact] = 0.4 if slip else 0.0
    outcome = "timeout" if rng.random() < 0.02 else "hit"
    return {
        "study": "simulated study", "participant": name, "session": 1, "condition": condition, "block": position,
        "position": position, "phase": phase, "trial": trial, "attempt": 1, "target": f"t{trial}",
        "seed": int(rng.integers(1 << 30)), "outcome": outcome, "completion_s": total if outcome == "hit" else np.nan,
        "mean_theta_deg": theta, "contacts": int(bool(slip)), **{f"time_{k}_s": v for k, v in times.items()},
        "state_order": ">".join([*early, *wobble, *slip, "target_hit"]), "path_mm": float(rng.gamma(30, 2)),
        "sparc": float(rng.normal(-4, 0.6)), "vibrating_s": times[mis] + times[mis_app] if touch else np.nan,
    }  # fmt: skip


def _sus(rng, name, condition, position):
    mood = rng.normal(0.9 + 0.35 * condition.endswith("haptic"), 0.5)
    for item in range(1, 11):
        agrees = mood if item % 2 else -mood
        answer = int(np.clip(round(3 + agrees + rng.normal(0, 0.6)), 1, 5))
        yield {
            "study": "simulated study", "participant": name, "condition": condition, "position": position,
            "questionnaire": "sus", "item": item, "answer": answer,
        }  # fmt: skip


def write_study(folder: Path, tables: dict[str, pd.DataFrame]) -> Path:
    """Write tables as CSV."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False)
    return folder


def freeze(folder: Path, protocol: str = PROTOCOL, questionnaires: dict[str, str] | None = None) -> Path:
    """Write `study.json` with a protocol and the texts of its questionnaires by name; return the folder."""
    named = {f"questionnaire {name}": text for name, text in (questionnaires or {}).items()}
    (folder / "study.json").write_text(json.dumps({"parts": {"study.toml": protocol, **named}}))
    return folder
