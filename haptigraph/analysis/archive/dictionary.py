"""The tables of an archive: name, type, unit and meaning of every column."""

from collections.abc import Iterable
from typing import Literal, NamedTuple, TypeAlias

from haptigraph.analysis.exporting.columns import Column as ExportedColumn
from haptigraph.analysis.exporting.columns import certainty_columns, measure_columns, sd_name, unit_of
from haptigraph.scene.meanings import meaning_of

__all__ = ["RUNS", "STEPS", "Column", "columns_of_steps", "measures_among"]

Kind: TypeAlias = Literal["text", "integer", "number", "yes_no", "time", "numbers", "integers"]


class Column(NamedTuple):
    """One column; `numbers` and `integers` are maps from names to values."""

    name: str
    kind: Kind
    meaning: str
    unit: str = ""


RUNS = (
    Column("recording", "text", "path of the file in the archive"),
    Column("sha256", "text", "of the file"),
    Column("bytes", "integer", "size of the file", "B"),
    Column("changed_ns", "integer", "when the file was changed, since 1970", "ns"),
    Column("problem", "text", "why it cannot be read; empty: it can"),
    Column("started_utc", "time", "when the run began"),
    Column("length_s", "number", "from the first to the last step", "s"),
    Column("steps", "integer", "number of steps"),
    Column("rate_hz", "number", "nominal rate of images", "Hz"),
    Column("version", "text", "of haptigraph that wrote it"),
    Column("format", "text", "of the recording"),
    Column("source", "text", "where the images came from"),
    Column("perceiver", "text", "what detected the needle"),
    Column("procedure", "text", "name of the procedure"),
    Column("procedure_sha256", "text", "of the procedure's text"),
    Column("registration_sha256", "text", "of the registration's text"),
    Column("settings", "text", "that were not the default, as KEY=VALUE"),
    Column("participant", "text", "pseudonym; empty: none"),
    Column("trial", "text", "name of the trial; empty: none"),
    Column("is_interrupted", "yes_no", "the run was killed; `haptigraph recover` completes the file"),
    Column("is_recovered", "yes_no", "recovered from a damaged recording, so that steps may be missing"),
    Column("outcome", "text", "hit, no hit, or no run: it never started"),
    Column("completion_s", "number", "from the start of the run to its end; empty without a hit", "s"),
    Column("mean_theta_deg", "number", "mean angle from start to end, weighted by time", "deg"),
    Column("contacts", "integer", "unintended contacts from start to end"),
    Column("state_changes", "integer", "from start to end"),
    Column("alarms", "integer", "how often a state of the kind alarm was entered, in the whole recording"),
    Column("tipless_steps", "integer", "steps with a needle whose tip was not visible"),
    Column("longest_tipless_s", "number", "longest time without a visible tip", "s"),
    Column("broken_claims", "integer", "how often a claim about time was broken"),
    Column("faulty_steps", "integer", "steps with a fault"),
    Column("faults", "integers", "number of faults by their place"),
    Column(
        "run_state_s", "numbers", "time in each state from the start of the run to its end; 0: never", "s"
    ),
    Column("state_s", "numbers", "time in each state of its procedure, whole recording; 0: never", "s"),
    Column("part", "text", "the file of the archive that has its steps"),
)


def _of(exported: Iterable[ExportedColumn]) -> tuple[Column, ...]:
    """Return numbers that an export has, too, under the same names."""
    return tuple(Column(each.name, "number", each.meaning, unit_of(each.name)) for each in exported)


STEPS = (
    Column("recording", "text", "path of the file in the archive"),
    Column("step", "integer", "number in the recording, from 0"),
    Column("time_s", "number", "since the first step", "s"),
    Column("state", "text", "the surgical state"),
    Column("plays", "text", "the pattern commanded"),
    Column("amplitude", "number", "commanded at that moment, 0 to 1; haptics.max_amplitude may limit it"),
    Column("faults", "integer", "number of faults"),
    *_of(certainty_columns()),
)
"""Followed by columns for the measures of all procedures, named as in them, and their standard deviations."""


def columns_of_steps(names: Iterable[str]) -> tuple[Column, ...]:
    """Return the columns of the table `steps` that has these names."""
    return (*STEPS, *_of(measure_columns({name: meaning_of(name) for name in measures_among(names)})))


def measures_among(names: Iterable[str]) -> list[str]:
    """Return the measures among the columns of `steps`, without their standard deviations."""
    known = {column.name for column in STEPS}
    others = [name for name in names if name not in known]
    sds = {sd_name(name) for name in others}
    return [name for name in others if name not in sds]
