"""Read and check the tidy tables of a study."""

from pathlib import Path

import pandas as pd
from msgspec import Struct, field

from haptigraph.analysis.study.preregistered.frozen import FrozenProtocol, read_frozen
from haptigraph.checksum import sha256_of
from haptigraph.errors import BadInput

__all__ = ["StudyTables", "read_tables"]

COLUMNS = {
    "trials": {
        *("study", "participant", "condition", "position", "phase", "trial", "attempt", "outcome"),
        *("completion_s", "mean_theta_deg"),
    },
    "answers": {"participant", "condition", "questionnaire", "item", "answer"},
    "participants": {"participant"},
    "calibration": {
        "participant",
        "device",
        "task",
        "number",
        "round",
        "pattern",
        "amplitude",
        "response",
        "correct",
    },
}
TEXT_COLUMNS = {
    *("study", "participant", "condition", "phase", "target", "outcome", "state_order", "started_utc"),
    *("recording", "recording_sha256", "procedure_sha256", "software", "answered_utc", "questionnaire"),
    *("item", "answer", "order", "consented_utc", "void"),
}
CHOICES = {"phase": ("training", "trial"), "outcome": ("hit", "timeout", "aborted")}
KEYS = {
    "trials": ("participant", "condition", "block", "phase", "trial", "attempt"),
    "answers": ("participant", "condition", "position", "questionnaire", "item"),
    "participants": ("participant",),
    "calibration": ("participant", "device", "task", "number"),
}
NUMERIC_SUFFIXES = ("_s", "_ms", "_mm", "_mm2", "_deg", "_mm_s", "_fraction")
NUMERIC_COLUMNS = (
    *("session", "block", "position", "trial", "attempt", "contacts", "sparc", "log_jerk"),
    *("skipped_images", "long_gaps", "number", "round", "amplitude", "correct"),
)


class StudyTables(Struct, frozen=True):
    """The tables of one study; a missing value is NaN."""

    folder: Path
    trials: pd.DataFrame
    answers: pd.DataFrame
    participants: pd.DataFrame
    sha256: dict[str, str]
    """Of every file read, by its name."""
    protocol: FrozenProtocol = FrozenProtocol()
    calibration: pd.DataFrame = field(
        default_factory=lambda: pd.DataFrame(columns=sorted(COLUMNS["calibration"]))
    )
    """The stimuli of the calibration; empty without one."""

    @property
    def study(self) -> str:
        """The name of the study."""
        return str(self.trials["study"].iloc[0])

    @property
    def is_simulated(self) -> bool:
        """Whether a column `simulated` or the study's name indicates that no people took part."""
        columns = [table["simulated"] for table in (self.trials, self.participants) if "simulated" in table]
        is_marked = any(column.astype(str).str.lower().isin(("true", "1", "yes")).any() for column in columns)
        return is_marked or "simulated" in self.study.lower()

    @property
    def withdrawn(self) -> list[str]:
        """Participants who withdrew."""
        if "withdrawn_utc" not in self.participants:
            return []
        return sorted(self.participants.loc[self.participants["withdrawn_utc"].notna(), "participant"])

    @property
    def erased(self) -> list[str]:
        """Participants who withdrew and whose data were erased."""
        people = self.participants
        if not {"withdrawn_utc", "enrolled_utc"} <= set(people):
            return []
        return sorted(people.loc[people["withdrawn_utc"] == people["enrolled_utc"], "participant"])


def read_tables(folder: str | Path) -> StudyTables:
    """Read the tables of an exported study.

    Args:
        folder: Contains trials.csv (or .parquet) and optionally answers and participants.

    Raises:
        BadInput: If a table is missing, lacks a column, or contains an invalid value.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise BadInput("no such folder; give the folder of an exported study", folder)
    paths = {name: path for name in COLUMNS if (path := _path_of(folder, name)) is not None}
    if "trials" not in paths:
        raise BadInput("contains neither trials.csv nor trials.parquet; export the study first", folder)
    tables = {
        name: _read(paths[name], name) if name in paths else pd.DataFrame(columns=sorted(COLUMNS[name]))
        for name in COLUMNS
    }
    studies = sorted(set(tables["trials"]["study"].dropna()))
    if len(studies) != 1:
        found = ", ".join(studies) or "none"
        raise BadInput(f"contains {len(studies)} studies ({found}); expected one", paths["trials"])
    digests = {path.name: sha256_of(path) for path in paths.values()}
    trials, answers, participants, calibration = (tables[name] for name in COLUMNS)
    protocol = read_frozen(folder / "study.json")
    return StudyTables(folder, trials, answers, participants, digests, protocol, calibration)


def _path_of(folder: Path, name: str) -> Path | None:
    return next((path for end in ("csv", "parquet") if (path := folder / f"{name}.{end}").is_file()), None)


def _read(path: Path, name: str) -> pd.DataFrame:
    table = _parse(path)
    missing = sorted(COLUMNS[name] - set(table.columns))
    if missing:
        raise BadInput(f"lacks the columns {', '.join(missing)}", path)
    if name == "trials" and table.empty:
        raise BadInput("contains no trial", path)
    for column in table.columns if name != "participants" else ():  # its columns are the study's items
        is_number = column.endswith(NUMERIC_SUFFIXES) or column in NUMERIC_COLUMNS
        if is_number and column not in TEXT_COLUMNS:
            table[column] = _numbers(table[column], path)
    for column in ("participant", *(("phase",) if name == "trials" else ())):
        _refuse_rows(table[column].isna(), f"{column} is empty", path)
    if name == "trials":
        _refuse_rows(table["condition"].isna() & (table["phase"] == "trial"), "condition is empty", path)
    for column, valid in CHOICES.items() if name == "trials" else ():
        wrong = ~table[column].isin(valid) & table[column].notna()  # a running trial has no outcome
        _refuse_rows(wrong, f"{column} must be one of {', '.join(valid)}", path)
    if name == "trials":
        _refuse_rows(table["completion_s"] < 0, "completion_s is negative", path)
    keys = [key for key in KEYS[name] if key in table]
    _refuse_rows(table.duplicated(keys), f"duplicate row with the same {', '.join(keys)}", path)
    return table


def _parse(path: Path) -> pd.DataFrame:
    try:
        if path.suffix == ".parquet":
            return pd.read_parquet(path)
        return pd.read_csv(
            path,
            dtype=str,
            keep_default_na=False,
            na_values=[""],
            encoding="utf-8",
        )
    except ImportError:
        raise BadInput("Parquet needs pyarrow, which is not installed; export CSV instead", path) from None
    except (ValueError, OSError) as error:
        raise BadInput(f"cannot be read: {error}", path) from None


def _numbers(column: pd.Series, path: Path) -> pd.Series:
    numbers = pd.to_numeric(column, errors="coerce").astype(float)
    infinite = numbers.abs() == float("inf")
    _refuse_rows((numbers.isna() & column.notna()) | infinite, f"{column.name} is not a number", path)
    return numbers


def _refuse_rows(wrong: pd.Series, problem: str, path: Path) -> None:
    if wrong.any():
        raise BadInput(problem, path, f"line {int(wrong.to_numpy().argmax()) + 2}")
