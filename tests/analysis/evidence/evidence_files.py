"""Files of results for a safety case, and recordings, in which every claim holds unless a test says otherwise."""

from pathlib import Path

import msgspec

from haptigraph import assemble
from haptigraph.analysis.evaluation.origin import Origin
from haptigraph.analysis.evidence.campaign import FORMAT, Session, Trial
from haptigraph.analysis.evidence.case import MIN_TRIALS
from haptigraph.analysis.evidence.hazards import FAULTS
from haptigraph.config import load_config

SCORES = {
    "clip": "A_easy",
    "perceiver": "tracker",
    "images": 4000,
    "detection_rate": 1.0,
    "false_detections": 1,
    "angle_error_deg": {"shallow": {"median": 0.05, "p95": 0.2}, "deep": {"median": 0.02, "p95": 0.1}},
    "state_agreement": 0.98,
    "wrong_contact_images": 0,
    "contact_images": 70,
    "missed_contact_images": 0,
    "tip_known_rate": 0.99,
    "tip_far_rate": 0.002,
    "tip_z": {"p68": 0.7, "p95": 1.6, "p997": 2.9},
}


def write_faults(path: Path, origin: Origin | None, failing: str = "", left_out: str = "") -> Path:
    session = [Session(FORMAT, 1, origin)] if origin else []
    trials = [
        Trial(kind, number, silence_ms=100.0, failure="it vibrates" if (kind, number) == (failing, 7) else "")
        for kind in FAULTS
        for number in range(MIN_TRIALS)
        if kind != left_out
    ]
    path.write_bytes(b"\n".join(map(msgspec.json.encode, (*session, *trials))) + b"\n")
    return path


def write_scores(path: Path, origin: Origin | None, **scores: object) -> Path:
    made = {"origin": origin} if origin else {}
    path.write_bytes(msgspec.json.encode({**SCORES, **scores, **made}))
    return path


def record(uri: str, path: Path, procedure: str = "subretinal_injection") -> Path:
    settings = (f"source.uri={uri}", "run.realtime=false", f'recording.path="{path}"')
    assemble.build(load_config(None, (*settings, f'run.procedure="{procedure}"'))).run()
    return path
