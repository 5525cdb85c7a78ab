"""Practice with a score: each run from entry to hit becomes a row of a file, beside the best so far.

The score is a penalised time: completion time, 10 s for each unintended contact, and 1 s for each degree of
mean theta. Lower is better. The penalties are chosen to discourage haste; they measure no skill.
"""

import csv
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.errors import BadInput
from haptigraph.graph import Triplet
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Capture, Fault, Step

__all__ = ["Practice"]

CONTACT_S, DEGREE_S = 10.0, 1.0
COLUMNS = ("at_utc", "procedure", "score_s", "completion_s", "mean_theta_deg", "contacts")


class Practice:
    """A sink that scores runs; the next one begins when the tip has left the eye and enters again.

    Args:
        path: The CSV file of all scores; created if missing.
        procedure: Start and end of a run. Scores of other procedures are not compared.
        now: Returns the time of the day.
        report: Called with a sentence after every run.

    Raises:
        BadInput: If the file is none of scores or cannot be written, or the procedure defines no run.
    """

    def __init__(
        self,
        path: str | Path,
        procedure: Procedure,
        now: Callable[[], datetime],
        report: Callable[[str], None],
    ) -> None:
        self.dropped = 0
        self._path, self._procedure, self._now, self._report = Path(path), procedure, now, report
        if not procedure.span.is_defined_in(procedure.schema):
            raise BadInput(
                "has no edge that begins a run, so there is no score", f"procedure {procedure.name}"
            )
        self._run, self._is_over = RunMeasures(span=procedure.span), False
        self._faults: list[Fault] = []
        self._scores_s = self._read()

    def write(self, capture: Capture, step: Step) -> None:
        """Take the next step; its run may end with it."""
        if self._is_over:
            is_outside = Triplet(*self._procedure.span.begins) not in step.graph
            if "needle_tip" not in step.observation.found or not is_outside:
                return  # a needle that is lost has not left the eye
            self._run, self._is_over = RunMeasures(span=self._procedure.span), False
        self._run.add(step)
        completion_s, theta_deg = self._run.completion_s, self._run.mean_theta_deg
        if completion_s is None:
            return
        self._is_over = True
        theta_deg = theta_deg or 0.0
        score_s = completion_s + CONTACT_S * self._run.contacts + DEGREE_S * theta_deg
        best_s = min(self._scores_s, default=None)
        self._scores_s.append(score_s)
        row = (self._procedure.name, round(score_s, 2), round(completion_s, 2), round(theta_deg, 2))
        self._save((self._now().isoformat(timespec="seconds"), *row, self._run.contacts))
        best = (
            f"the best so far is {best_s:.1f}"
            if best_s is not None and best_s <= score_s
            else "your best so far"
        )
        self._report(
            f"Run {len(self._scores_s)}: score {score_s:.1f} ({completion_s:.1f} s, "
            f"{theta_deg:.1f}° mean theta, contacts: {self._run.contacts}), {best}. "
            "Leave the eye to try again."
        )

    def take_faults(self) -> tuple[Fault, ...]:
        """Return what could not be saved since the previous call."""
        faults, self._faults = tuple(self._faults), []
        return faults

    def close(self) -> None:
        """Do nothing: every score is saved when its run ends."""

    def _read(self) -> list[float]:
        """Return the scores of this procedure."""
        try:
            if not self._path.exists():
                with self._path.open("x", newline="", encoding="utf-8") as file:
                    csv.writer(file).writerow(COLUMNS)
            with self._path.open("r+", newline="", encoding="utf-8") as file:
                reader = csv.DictReader(file)
                if tuple(reader.fieldnames or ()) != COLUMNS:
                    raise BadInput(
                        f"is no file of scores; expected the columns {', '.join(COLUMNS)}", self._path
                    )
                return [float(row["score_s"]) for row in reader if row["procedure"] == self._procedure.name]
        except OSError as error:
            raise BadInput(f"cannot be written ({error.strerror})", self._path) from None
        except (ValueError, TypeError, csv.Error) as error:
            raise BadInput(f"is damaged ({error})", self._path) from None

    def _save(self, row: tuple[object, ...]) -> None:
        try:
            with self._path.open("a", newline="", encoding="utf-8") as file:
                csv.writer(file).writerow(row)
        except OSError as error:
            self._faults.append(Fault("recorder", f"the score was not saved ({error.strerror})"))
