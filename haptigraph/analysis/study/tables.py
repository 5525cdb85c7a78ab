"""The tidy tables of a study, read and checked. Knows nothing of how they were made."""

import hashlib
import tomllib
from pathlib import Path

import msgspec
import pandas as pd
from msgspec import Struct

from haptigraph.errors import BadInput

__all__ = ["StudyTables", "read_tables"]

COLUMNS = {
    "trials": {
        *("study", "participant", "condition", "position", "phase", "trial", "attempt", "outcome"),
        *("completion_s", "mean_theta_deg"),
    },
    "answers": {"participant", "condition", "questionnaire", "item", "answer"},
    "participants": {"participant"},
}
WORDS = {
    *("study", "participant", "condition", "phase", "target", "outcome", "state_order", "started_utc"),
    *("recording", "recording_sha256", "procedure_sha256", "software", "answered_utc", "questionnaire"),
    *("item", "answer", "order", "consented_utc", "void"),
}
CHOICES = {"phase": ("training", "trial"), "outcome": ("hit", "timeout", "aborted")}
ONCE = {
    "trials": ("participant", "condition", "block", "phase", "trial", "attempt"),
    "answers": ("participant", "condition", "position", "questionnaire", "item"),
    "participants": ("participant",),
}
NUMERIC = ("_s", "_ms", "_mm", "_mm2", "_deg", "_mm_s")
COUNTED = ("session", "block", "position", "trial", "attempt", "contacts", "sparc", "log_jerk")


class StudyTables(Struct, frozen=True):
    """The tables of one study; a missing value is NaN."""

    folder: Path
    trials: pd.DataFrame
    answers: pd.DataFrame
    participants: pd.DataFrame
    sha256: dict[str, str]
    """Of every file read, by its name."""
    protocol_conditions: list[str] = []
    """In the order of the protocol, where the export has one."""
    title: str = ""
    """Of the study, where the export has one."""

    @property
    def study(self) -> str:
        """The name of the study."""
        return str(self.trials["study"].iloc[0])

    @property
    def says_simulated(self) -> bool:
        """Whether a column `simulated`, or the study's name, tells that no people took part."""
        columns = [table["simulated"] for table in (self.trials, self.participants) if "simulated" in table]
        told = any(column.astype(str).str.lower().isin(("true", "1", "yes")).any() for column in columns)
        return told or "simulated" in self.study.lower()

    @property
    def withdrawn(self) -> list[str]:
        """Participants who left the study."""
        if "withdrawn_utc" not in self.participants:
            return []
        return sorted(self.participants.loc[self.participants["withdrawn_utc"].notna(), "participant"])

    @property
    def erased(self) -> list[str]:
        """Those of them of whom nothing was kept."""
        people = self.participants
        if not {"withdrawn_utc", "enrolled_utc"} <= set(people):
            return []
        return sorted(people.loc[people["withdrawn_utc"] == people["enrolled_utc"], "participant"])


def read_tables(folder: str | Path) -> StudyTables:
    """Read the tables that a study was exported to.

    Args:
        folder: Holds trials.csv (or .parquet) and, where there were any, answers and participants.

    Raises:
        BadInput: If a table is missing, lacks a column, or holds what makes no sense.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise BadInput("no such folder; give the one that the study was exported to", folder)
    paths = {name: path for name in COLUMNS if (path := _path_of(folder, name)) is not None}
    if "trials" not in paths:
        raise BadInput("holds neither trials.csv nor trials.parquet; export the study first", folder)
    tables = {
        name: _read(paths[name], name) if name in paths else pd.DataFrame(columns=sorted(COLUMNS[name]))
        for name in COLUMNS
    }
    studies = sorted(set(tables["trials"]["study"].dropna()))
    if len(studies) != 1:
        found = ", ".join(studies) or "none"
        raise BadInput(f"holds {len(studies)} studies ({found}); one at a time", paths["trials"])
    digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths.values()}
    title, conditions = _protocol(folder / "study.json")
    told = (tables["trials"], tables["answers"], tables["participants"])
    return StudyTables(folder, *told, digests, conditions, title)


def _path_of(folder: Path, name: str) -> Path | None:
    return next((path for end in ("csv", "parquet") if (path := folder / f"{name}.{end}").is_file()), None)


def _protocol(path: Path) -> tuple[str, list[str]]:
    """Return title and conditions of the frozen protocol, which an export keeps in `study.json`."""
    if not path.is_file():
        return "", []
    try:
        frozen = msgspec.json.decode(path.read_bytes(), type=_Frozen)
        texts = [text for name, text in frozen.parts.items() if Path(name).name == "study.toml"]
        protocols = [tomllib.loads(text) for text in texts]
        names = [str(each["name"]) for protocol in protocols for each in protocol.get("condition", [])]
        return frozen.title, names
    except (msgspec.MsgspecError, tomllib.TOMLDecodeError, TypeError, KeyError) as error:
        raise BadInput(f"cannot be read: {error}", path) from None


class _Frozen(Struct, frozen=True):
    title: str = ""
    parts: dict[str, str] = {}


def _read(path: Path, name: str) -> pd.DataFrame:
    table = _parse(path)
    missing = sorted(COLUMNS[name] - set(table.columns))
    if missing:
        raise BadInput(f"lacks the columns {', '.join(missing)}", path)
    if name == "trials" and table.empty:
        raise BadInput("holds no trial", path)
    for column in table.columns if name != "participants" else ():  # whose columns the study names itself
        if column not in WORDS and (column.endswith(NUMERIC) or column in COUNTED):
            table[column] = _numbers(table[column], path)
    for column in ("participant", *(("phase",) if name == "trials" else ())):
        _refuse_rows(table[column].isna(), f"{column} is empty", path)
    if name == "trials":
        _refuse_rows(table["condition"].isna() & (table["phase"] == "trial"), "condition is empty", path)
    for column, valid in CHOICES.items() if name == "trials" else ():
        wrong = ~table[column].isin(valid) & table[column].notna()  # a trial that still runs has no outcome
        _refuse_rows(wrong, f"{column} is none of {', '.join(valid)}", path)
    if name == "trials":
        _refuse_rows(table["completion_s"] < 0, "completion_s is negative", path)
    keys = [key for key in ONCE[name] if key in table]
    _refuse_rows(table.duplicated(keys), f"the same {', '.join(keys)} stand twice", path)
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
        raise BadInput(
            "Parquet is read by pyarrow, which is not installed; export CSV instead", path
        ) from None
    except (ValueError, OSError) as error:
        raise BadInput(f"cannot be read: {error}", path) from None


def _numbers(column: pd.Series, path: Path) -> pd.Series:
    numbers = pd.to_numeric(column, errors="coerce").astype(float)
    infinite = numbers.abs() == float("inf")
    _refuse_rows((numbers.isna() & column.notna()) | infinite, f"{column.name} is no number", path)
    return numbers


def _refuse_rows(wrong: pd.Series, problem: str, path: Path) -> None:
    if wrong.any():
        raise BadInput(problem, path, f"line {int(wrong.to_numpy().argmax()) + 2}")
