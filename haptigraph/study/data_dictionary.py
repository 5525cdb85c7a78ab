"""The data dictionary: every column of an export, with unit, meaning and source.

It defines the exports. `analysis` computes the measures; the store refuses a measure that is not listed here.
"""

import math
import re
from collections.abc import Iterable, Mapping
from typing import Literal, NamedTuple, TypeAlias

from haptigraph.errors import BadInput, unknown_name

__all__ = ["COLUMNS", "MEASURES", "TRIAL_MEASURES", "Field", "check_measures", "fields_of", "time_field"]

TIME_IN_STATE = re.compile(r"time_(.+)_s")


class Field(NamedTuple):
    """One column."""

    table: str
    name: str
    kind: Literal["text", "integer", "number"]
    unit: str
    meaning: str
    source: str
    empty: str = "never"
    """When there is no value; the field is empty then, never 0."""


Kind: TypeAlias = Literal["text", "integer", "number"]


def _fields(
    table: str, source: str, *rows: tuple[str, Kind, str, str] | tuple[str, Kind, str, str, str]
) -> list[Field]:
    return [
        Field(table, name, kind, unit, meaning, source, *empty) for name, kind, unit, meaning, *empty in rows
    ]


RUN = "from the tip's first entry into the globe to the first Target Hit, or to the trial's end"
WHERE = f"{RUN}; over the whole trial if the tip never entered"
NO_RUN = "no recording, or the tip never entered the globe"
NO_MOVEMENT = f"{NO_RUN}; fewer than 10 images/s with a visible tip"
NO_WHOLE_MOVEMENT = f"{NO_MOVEMENT}; more than 0.5 s without a visible tip"
NO_SMOOTHNESS = f"{NO_WHOLE_MOVEMENT}; fewer than 20 images/s; no motion"
EMPTY = {
    "completion_s": f"{NO_RUN}; no Target Hit",
    "mean_theta_deg": f"{NO_RUN}; the angle was never known",
    "path_mm": NO_WHOLE_MOVEMENT,
    "sparc": NO_SMOOTHNESS,
    "log_jerk": NO_SMOOTHNESS,
    "tremor_power_mm2": f"{NO_RUN}; never 2 s at 24.5 images/s without a gap of more than 0.1 s",
    "reaction_ms": f"{NO_MOVEMENT}; no cue with a correction 0.1 to 2 s later",
    "approach_speed_mm_s": f"{NO_MOVEMENT}; the tip never approached the retina",
    "touch_output": f"{NO_RUN}; no haptic feedback, or the output is not known",
    "delivered_s": f"{NO_RUN}; no output that confirms",
    "touch": f"{NO_RUN}; no sham",
    "weakest_amplitude": f"{NO_RUN}; the procedure's own amplitudes",
}
"""When a measure is empty; the others are with `NO_RUN`."""
TRIAL_MEASURES = _fields(
    "trials",
    "recording",
    ("completion_s", "number", "s", "from the tip's first entry into the globe to the first Target Hit"),
    ("mean_theta_deg", "number", "deg", f"time-weighted mean angle from shaft to line trocar-target {RUN}"),
    ("contacts", "integer", "", f"entries into retinal_contact {RUN}"),
    ("state_order", "text", "", f"states in the order of occurrence {RUN}, joined by >"),
    ("path_mm", "number", "mm", f"length of the tip's path {RUN}, low-pass filtered at 5 Hz"),
    ("sparc", "number", "", f"spectral arc length of the tip's speed {RUN}; nearer 0 is smoother"),
    ("log_jerk", "number", "", f"log dimensionless jerk of the tip's speed {RUN}; nearer 0 is smoother"),
    ("tremor_power_mm2", "number", "mm^2", f"variance of the visible tip in 8 to 12 Hz, both axes, {RUN}"),
    ("vibrating_s", "number", "s", f"time with a commanded amplitude above 0 {RUN}"),
    ("reaction_ms", "number", "ms", f"median time from a cue, felt or not, to a decrease of theta {RUN}"),
    ("approach_speed_mm_s", "number", "mm/s", f"maximum speed towards the retina while approaching it {RUN}"),
    (
        "touch_output",
        "text",
        "",
        "outputs whose test pulse the participant felt, joined by +",
    ),
    (
        "delivered_s",
        "number",
        "s",
        "time for which an output confirmed an amplitude above 0 (serial: the board its pin; drv2605: the "
        f"chip its register; gamepad and controller: driver or browser the command) {RUN}",
    ),
    ("touch", "text", "", "sham: the vibration came at random times, whatever the state"),
    ("weakest_amplitude", "number", "", "amplitude of the weakest pattern, where the calibration set it"),
)
QUALITY = _fields(
    "trials",
    "recording",
    ("images_per_s", "number", "1/s", f"number of images over duration {WHERE}"),
    ("late_images_fraction", "number", "", f"share of images later than 1.5 median intervals {WHERE}"),
    ("skipped_images", "integer", "", f"images that came while the program processed earlier ones {WHERE}"),
    ("unseen_fraction", "number", "", f"share of the time without a needle or a visible tip {WHERE}"),
    ("long_gaps", "integer", "", f"intervals of more than 0.5 s without a visible tip {WHERE}"),
    ("longest_gap_s", "number", "s", f"longest time without a visible tip, from image to image, {WHERE}"),
)
"""Columns that an export has if any trial has a value."""
NO_QUALITY = "no recording, or measured by haptigraph 0.1.0"
MEASURES = [
    *(field._replace(empty=EMPTY.get(field.name, NO_RUN)) for field in TRIAL_MEASURES),
    *(field._replace(empty=NO_QUALITY) for field in QUALITY),
]
"""Measures of a trial, besides `time_<state>_s` for each state of the procedure."""
ONLY_IF_PRESENT = ("touch", "weakest_amplitude", "touch_output", "delivered_s")
"""Measures without a column where no trial has them."""

TRIAL = _fields(
    "trials",
    "protocol",
    ("study", "text", "", "the study's name"),
    ("participant", "text", "", "pseudonym"),
    ("session", "integer", "", "session in which the trial began, from 1"),
    ("condition", "text", "", "name of the condition"),
    ("block", "integer", "", "block of trials under the condition, from 1", "in training"),
    ("position", "integer", "", "position of the condition in the order, from 1", "before the first"),
    ("phase", "text", "", "training or trial"),
    ("trial", "integer", "", "within the block or training, from 1"),
    ("attempt", "integer", "", "from 1; above 1 where the trial was repeated"),
    (
        "attempt_reason",
        "text",
        "",
        "why this attempt was made: first; aborted: the one before was aborted or interrupted; repeated: the "
        "one before was completed, and the experimenter repeated the trial",
    ),
    ("target", "text", "", "name of the target position"),
    ("seed", "integer", "", "seed of the attempt for simulations"),
)
RECORD = _fields(
    "trials",
    "runner",
    ("outcome", "text", "", "hit, timeout or aborted", "the trial is running"),
    ("void", "text", "", "why the attempt does not count", "it counts"),
    ("started_utc", "text", "ISO 8601", "start of the trial"),
    ("ended_utc", "text", "ISO 8601", "end of the trial", "the trial is running"),
    ("recording", "text", "", "path relative to the study's folder", "no recording"),
    ("recording_sha256", "text", "", "SHA-256 of the recording", "no recording, or an incomplete one"),
    ("procedure_sha256", "text", "", "SHA-256 of the procedure that was run"),
    ("software", "text", "", "version of haptigraph"),
)
ONE_OFF = "a one-off questionnaire"
COLUMNS: dict[str, list[Field]] = {
    "trials": [*TRIAL, *RECORD[:2], *MEASURES, *RECORD[2:]],
    "answers": _fields(
        "answers",
        "participant",
        ("study", "text", "", "the study's name"),
        ("participant", "text", "", "pseudonym"),
        ("condition", "text", "", "condition that the answer is about", ONE_OFF),
        ("position", "integer", "", "position of that condition, from 1", ONE_OFF),
        ("questionnaire", "text", "", "name of the questionnaire"),
        ("item", "text", "", "key of the item"),
        ("answer", "text", "", "as given"),
        ("answered_utc", "text", "ISO 8601", "when it was last changed"),
        ("session", "integer", "", "session in which it was given, from 1"),
    ),
    "calibration": _fields(
        "calibration",
        "participant",
        ("study", "text", "", "the study's name"),
        ("participant", "text", "", "pseudonym"),
        ("task", "text", "", "threshold: was it felt? patterns: which one was it?"),
        ("device", "text", "", "the station's haptic device"),
        ("number", "integer", "", "of the stimulus within the task on this device, from 1"),
        ("round", "integer", "", "round of the patterns, from 1"),
        ("pattern", "text", "", "the pattern that was played", "in the task of the threshold"),
        ("amplitude", "number", "", "of the stimulus, in [0, 1]; 0: a catch trial"),
        ("response", "text", "", "felt, not felt, or the name of a pattern"),
        ("correct", "integer", "", "1: felt, not felt in a catch trial, or named correctly; 0: not"),
        ("page_output", "text", "", "where the participant's page played it too", "nowhere"),
        ("at_utc", "text", "ISO 8601", "time of the response"),
        ("session", "integer", "", "session in which it was given, from 1"),
    ),
    "participants": _fields(
        "participants",
        "runner",
        ("study", "text", "", "the study's name"),
        ("participant", "text", "", "pseudonym"),
        ("order", "text", "", "conditions in the participant's order, joined by >"),
        ("consented_utc", "text", "ISO 8601", "when the participant consented", "not yet; or data erased"),
        ("slot", "integer", "", "place in the counterbalancing, from 0"),
        ("enrolled_utc", "text", "ISO 8601", "when the participant enrolled; after erasure, when that was"),
        (
            "withdrawn_utc",
            "text",
            "ISO 8601",
            "time of withdrawal; equal to enrolled_utc: data erased",
            "the participant did not withdraw",
        ),
        ("simulated", "integer", "", "1: a simulated participant, 0: a person"),
    ),
    "sessions": _fields(
        "sessions",
        "runner",
        ("study", "text", "", "the study's name"),
        ("participant", "text", "", "pseudonym"),
        ("session", "integer", "", "uninterrupted period at one station, from 1"),
        ("station", "text", "", "name of the station"),
        ("opened_utc", "text", "ISO 8601", "start of the session"),
        (
            "closed_utc",
            "text",
            "ISO 8601",
            "end of the session; after a crash, the start of the next",
            "open",
        ),
    ),
    "stages": _fields(
        "stages",
        "runner",
        ("study", "text", "", "the study's name"),
        ("participant", "text", "", "pseudonym"),
        (
            "stage",
            "text",
            "",
            "briefing, consent, questionnaire, calibration, break or thanks, with position",
        ),
        ("session", "integer", "", "session in which it was completed"),
        ("done_utc", "text", "ISO 8601", "when it was completed"),
    ),
    "events": _fields(
        "events",
        "experimenter",
        ("study", "text", "", "the study's name"),
        ("participant", "text", "", "pseudonym"),
        ("number", "integer", "", "from 1"),
        ("session", "integer", "", "session in which it was noted"),
        (
            "kind",
            "text",
            "",
            "note; stop: the experimenter ended the session early; felt or unfelt: the participant's answer "
            "to a test pulse",
        ),
        ("text", "text", "", "the experimenter's words; for felt and unfelt, the outputs, joined by +"),
        ("at_utc", "text", "ISO 8601", "when it was noted"),
    ),
    "questionnaire_items": _fields(
        "questionnaire_items",
        "protocol",
        ("study", "text", "", "the study's name"),
        ("questionnaire", "text", "", "name of the questionnaire"),
        ("title", "text", "", "title of the questionnaire"),
        ("source", "text", "", "where the questionnaire was published", "not stated"),
        ("when", "text", "", "start, condition (after each), or end"),
        ("number", "integer", "", "position of the item in the questionnaire, from 1"),
        ("item", "text", "", "key of the item in `answers`"),
        ("wording", "text", "", "the question or statement"),
        ("kind", "text", "", "scale (whole numbers), number, choice or text"),
        ("low", "number", "", "the lowest answer", "no bound"),
        ("low_label", "text", "", "anchor of the lowest answer", "none"),
        ("high", "number", "", "the highest answer", "no bound"),
        ("high_label", "text", "", "anchor of the highest answer", "none"),
        ("choices", "text", "", "the choices, joined by |", "no choice"),
        ("unit", "text", "", "unit of the answers", "none"),
        ("required", "integer", "", "1: an answer is required"),
        ("reversed", "integer", "", "1: the score counts it from its high end"),
    ),
}
"""Columns by table, in order. The first three are for analysis; the others make an export complete."""


def time_field(name: str) -> Field | None:
    """Return the column for the time in a state, or None if the name is not of that form."""
    state = TIME_IN_STATE.fullmatch(name)
    if state is None:
        return None
    return Field("trials", name, "number", "s", f"time in {state[1]} {RUN}", "recording", NO_RUN)


def fields_of(table: str, names: Iterable[str] = ()) -> list[Field]:
    """Return the columns of a table, with the optional measures and times in states that are in `names`."""
    names = set(names)
    optional = {*ONLY_IF_PRESENT, *(field.name for field in QUALITY)} - names if table == "trials" else set()
    fields = [field for field in COLUMNS[table] if field.name not in optional]
    times = [field for name in sorted(names) if (field := time_field(name)) is not None]
    if table == "trials":
        index = [field.name for field in fields].index("contacts") + 1
        fields[index:index] = times
    return fields


def check_measures(measures: Mapping[str, float | int | str | None]) -> dict[str, float | int | str]:
    """Return measures in the stored form, without missing values.

    Raises:
        BadInput: If a measure is not in the dictionary, of the wrong type, or not finite.
    """
    defined = {field.name: field for field in MEASURES}
    checked: dict[str, float | int | str] = {}
    for name, value in measures.items():
        field = defined.get(name) or time_field(name)
        if field is None:
            raise BadInput(unknown_name("measure", name, [*defined, "time_<state>_s"]))
        if value is None or (isinstance(value, float) and math.isnan(value)):
            continue
        if field.kind == "number" and isinstance(value, int | float) and math.isfinite(value):
            checked[name] = float(value)
        elif (field.kind == "integer" and isinstance(value, int)) or (
            field.kind == "text" and isinstance(value, str)
        ):
            checked[name] = value
        else:
            raise BadInput(f"measure {name}: expected a finite {field.kind}, found {value!r}")
    return checked
