"""The data dictionary: every column of an export, with unit, meaning and source. Exports are made by it.

Measures are named here and computed in `analysis`; a measure that is not here is refused by the store.
"""

import math
import re
from collections.abc import Iterable, Mapping
from typing import Literal, NamedTuple

from haptigraph.errors import BadInput, unknown_name

__all__ = ["COLUMNS", "MEASURES", "Field", "check_measures", "fields_of", "time_field"]

TIME_IN_STATE = re.compile(r"time_(.+)_s")


class Field(NamedTuple):
    """One column."""

    table: str
    name: str
    kind: Literal["text", "integer", "number"]
    unit: str
    meaning: str
    source: str


def _fields(
    table: str, source: str, *rows: tuple[str, Literal["text", "integer", "number"], str, str]
) -> list[Field]:
    return [Field(table, name, kind, unit, meaning, source) for name, kind, unit, meaning in rows]


RUN = "between the tip's first being inside the globe and the first Target Hit, or the trial's end"
MEASURES = _fields(
    "trials",
    "recording",
    ("completion_s", "number", "s", "from the tip's first being inside the globe to the first Target Hit"),
    (
        "mean_theta_deg",
        "number",
        "deg",
        f"mean angle between shaft and line trocar to target, weighted by time, {RUN}",
    ),
    ("contacts", "integer", "", f"entries into retinal_contact {RUN}"),
    ("state_order", "text", "", f"states in the order they were traversed {RUN}, joined by >"),
    ("path_mm", "number", "mm", f"length of the tip's path {RUN}, low-passed at 5 Hz"),
    ("sparc", "number", "", f"spectral arc length of the tip's speed {RUN}; nearer 0 is smoother"),
    ("log_jerk", "number", "", f"log dimensionless jerk of the tip's speed {RUN}; nearer 0 is smoother"),
    ("tremor_power_mm2", "number", "mm^2", f"variance of the tip in 8 to 12 Hz, both axes, {RUN}"),
    ("vibrating_s", "number", "s", f"time with an amplitude above 0 commanded {RUN}"),
    (
        "reaction_ms",
        "number",
        "ms",
        f"median time from a cue's onset to theta's falling {RUN}; cues without touch too",
    ),
    ("approach_speed_mm_s", "number", "mm/s", f"maximum speed towards the retina while approaching it {RUN}"),
)
"""Measures of a trial; and `time_<state>_s` for each state of the procedure."""

TRIAL = _fields(
    "trials",
    "protocol",
    ("study", "text", "", "the study's name"),
    ("participant", "text", "", "pseudonym"),
    ("session", "integer", "", "stretch at a station in which the trial was begun, from 1"),
    ("condition", "text", "", "name of the condition"),
    ("block", "integer", "", "from 1; empty in training"),
    (
        "position",
        "integer",
        "",
        "place of the condition in the participant's order, from 1; empty before the first",
    ),
    ("phase", "text", "", "training or trial"),
    ("trial", "integer", "", "within the block or training, from 1"),
    ("attempt", "integer", "", "from 1; repeated trials have higher ones"),
    ("target", "text", "", "name of the target position"),
    ("seed", "integer", "", "drawn for the trial, for whatever simulates"),
)
RECORD = _fields(
    "trials",
    "runner",
    ("outcome", "text", "", "hit, timeout or aborted; empty: still running"),
    ("void", "text", "", "why the attempt does not count; empty: it does"),
    ("started_utc", "text", "ISO 8601", "when the trial was begun"),
    ("ended_utc", "text", "ISO 8601", "when it was ended"),
    ("recording", "text", "", "path from the study's folder"),
    ("recording_sha256", "text", "", "of the recording; empty: there is none, or not a whole one"),
    ("procedure_sha256", "text", "", "of the procedure it ran under"),
    ("software", "text", "", "version of haptigraph"),
)
COLUMNS: dict[str, list[Field]] = {
    "trials": [*TRIAL, RECORD[0], RECORD[1], *MEASURES, *RECORD[2:]],
    "answers": _fields(
        "answers",
        "participant",
        ("study", "text", "", "the study's name"),
        ("participant", "text", "", "pseudonym"),
        ("condition", "text", "", "name of the condition it is about; empty where asked once"),
        (
            "position",
            "integer",
            "",
            "of that condition in the participant's order, from 1; empty where asked once",
        ),
        ("questionnaire", "text", "", "name of the questionnaire"),
        ("item", "text", "", "key of the item"),
        ("answer", "text", "", "as given"),
        ("answered_utc", "text", "ISO 8601", "when it was last given"),
        ("session", "integer", "", "stretch at a station in which it was given, from 1"),
    ),
    "participants": _fields(
        "participants",
        "runner",
        ("study", "text", "", "the study's name"),
        ("participant", "text", "", "pseudonym"),
        ("order", "text", "", "conditions in the order met, joined by >"),
        ("consented_utc", "text", "ISO 8601", "when the participant agreed"),
        ("slot", "integer", "", "place in the balancing, from 0"),
        ("enrolled_utc", "text", "ISO 8601", "when the participant was taken in; if erased, when that was"),
        (
            "withdrawn_utc",
            "text",
            "ISO 8601",
            "when the participant left the study; empty: did not; the same as enrolled_utc: was erased",
        ),
        ("simulated", "integer", "", "1: a simulated participant, 0: a person"),
    ),
    "sessions": _fields(
        "sessions",
        "runner",
        ("study", "text", "", "the study's name"),
        ("participant", "text", "", "pseudonym"),
        ("session", "integer", "", "stretch at a station, from 1"),
        ("station", "text", "", "name of the station"),
        ("opened_utc", "text", "ISO 8601", "its beginning"),
        ("closed_utc", "text", "ISO 8601", "its end; after a crash, when the next began"),
    ),
    "stages": _fields(
        "stages",
        "runner",
        ("study", "text", "", "the study's name"),
        ("participant", "text", "", "pseudonym"),
        ("stage", "text", "", "briefing, consent, questionnaire, break or thanks, with its place"),
        ("session", "integer", "", "in which it was done"),
        ("done_utc", "text", "ISO 8601", "when it was done"),
    ),
    "events": _fields(
        "events",
        "experimenter",
        ("study", "text", "", "the study's name"),
        ("participant", "text", "", "pseudonym"),
        ("number", "integer", "", "from 1"),
        ("session", "integer", "", "in which it was noted"),
        ("kind", "text", "", "note, or stop: the session was ended early"),
        ("text", "text", "", "in words"),
        ("at_utc", "text", "ISO 8601", "when"),
    ),
}
"""Columns by table, in their order; the first three tables are for analysis, the rest completes them."""


def time_field(name: str) -> Field | None:
    """Return the column of a time in a state; None if the name is none."""
    state = TIME_IN_STATE.fullmatch(name)
    return Field("trials", name, "number", "s", f"time in {state[1]} {RUN}", "recording") if state else None


def fields_of(table: str, names: Iterable[str] = ()) -> list[Field]:
    """Return the columns of a table, with times in states among `names` after the number of contacts."""
    fields = list(COLUMNS[table])
    times = [field for name in sorted(set(names)) if (field := time_field(name)) is not None]
    if table == "trials":
        place = [field.name for field in fields].index("contacts") + 1
        fields[place:place] = times
    return fields


def check_measures(measures: Mapping[str, float | int | str | None]) -> dict[str, float | int | str]:
    """Return measures as they are stored: the missing ones left out.

    Raises:
        BadInput: If one is not in the dictionary, or not of its kind, or not finite.
    """
    known = {field.name: field for field in MEASURES}
    kept: dict[str, float | int | str] = {}
    for name, value in measures.items():
        field = known.get(name) or time_field(name)
        if field is None:
            raise BadInput(unknown_name("measure", name, [*known, "time_<state>_s"]))
        if value is None or (isinstance(value, float) and math.isnan(value)):
            continue
        if field.kind == "number" and isinstance(value, int | float) and math.isfinite(value):
            kept[name] = float(value)
        elif (field.kind == "integer" and isinstance(value, int)) or (
            field.kind == "text" and isinstance(value, str)
        ):
            kept[name] = value
        else:
            raise BadInput(f"measure {name}: expected a finite {field.kind}, found {value!r}")
    return kept
