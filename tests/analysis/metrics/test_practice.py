"""Practice: a score a run, kept in a file, compared with the best of the same procedure."""

from datetime import UTC, datetime

import pytest
from helpers import MS, call, needle

from haptigraph.analysis.metrics.practice import COLUMNS, Practice
from haptigraph.assemble import load_procedure
from haptigraph.commands.running import run_loop
from haptigraph.config import load_config
from haptigraph.errors import BadInput
from haptigraph.graph import SceneGraph, Triplet
from haptigraph.messages import OFF, Capture, Conclusion, HapticCommand, Observation, Step

INSIDE = Triplet("needle_tip", "inside", "eye_globe")
AT = datetime(2026, 11, 25, 14, tzinfo=UTC)


@pytest.fixture
def practise(tmp_path):
    """Play states at ten images a second; "lost" is an image without a needle. Return the sentences."""
    sentences = []
    procedure = load_procedure("subretinal_injection")

    def played(states, path=tmp_path / "scores.csv", theta_deg=3.0):
        practice = Practice(path, procedure, lambda: AT, sentences.append)
        for number, state in enumerate(states):
            stamp_ns = number * 100 * MS
            found = {} if state == "lost" else needle((0.0, 0.0), (1.0, 1.0))
            edges = (INSIDE,) if state not in ("lost", "outside_eye") else ()
            graph = SceneGraph(stamp_ns, edges=edges, measures={"theta_deg": theta_deg})
            conclusion = Conclusion(stamp_ns, state, 0, "off", "")
            command = HapticCommand(stamp_ns, OFF, stamp_ns)
            step = Step(number, stamp_ns, Observation(stamp_ns, found), graph, conclusion, command)
            practice.write(Capture(number, stamp_ns, None), step)
        return practice, sentences

    return played


WAY, AWAY = ["aligned_intraocular_navigation"] * 20, ["outside_eye"] * 5


def test_every_run_from_entry_to_hit_is_scored_and_compared_with_the_best(practise, tmp_path):
    slip = ["retinal_contact", "aligned_intraocular_navigation"]
    _, sentences = practise([*WAY, *slip, "target_hit", *AWAY, *WAY, "target_hit"])
    assert sentences == [
        "Run 1: score 15.2 (2.2 s, 3.0° mean theta, contacts: 1), your best so far. Leave the eye to try again.",
        "Run 2: score 5.0 (2.0 s, 3.0° mean theta, contacts: 0), your best so far. Leave the eye to try again.",
    ]
    practise([*WAY, *slip, "target_hit"])  # another day
    assert sentences[2].startswith("Run 3: score 15.2") and "the best so far is 5.0" in sentences[2]
    rows = (tmp_path / "scores.csv").read_text().splitlines()
    assert rows[0] == ",".join(COLUMNS) and len(rows) == 4
    assert rows[2] == "2026-11-25T14:00:00+00:00,subretinal_injection,5.0,2.0,3.0,0"


def test_staying_at_the_target_or_losing_the_needle_begins_no_other_run(practise):
    _, sentences = practise([*WAY, "target_hit", *WAY, "target_hit", "lost", *WAY, "target_hit"])
    assert len(sentences) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [("a,b\n1,2\n", "is no file of scores; expected the columns at_utc"), (None, "cannot be written")],
)
def test_a_file_that_is_none_of_scores_is_refused_and_stays(practise, tmp_path, text, message):
    path = tmp_path / "no" / "file.csv" if text is None else tmp_path / "table.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(BadInput, match=message):
        practise(WAY, path)
    assert text is None or path.read_text() == text


def test_a_score_that_cannot_be_saved_is_a_fault_and_the_run_goes_on(practise, tmp_path):
    path = tmp_path / "scores.csv"
    practice, _ = practise(WAY, path)
    path.unlink()
    path.mkdir()
    stamp_ns = 9_000 * MS
    graph = SceneGraph(stamp_ns, edges=(INSIDE,), measures={"theta_deg": 3.0})
    conclusion = Conclusion(stamp_ns, "target_hit", 0, "off", "")
    found = Observation(stamp_ns, needle((0.0, 0.0), (1.0, 1.0)))
    step = Step(99, stamp_ns, found, graph, conclusion, HapticCommand(stamp_ns, OFF, stamp_ns))
    practice.write(Capture(99, stamp_ns, None), step)
    (fault,) = practice.take_faults()
    assert fault.message == "the score was not saved (Is a directory)" and practice.take_faults() == ()


def test_a_run_of_the_phantom_is_scored(sparse_uri, tmp_path):
    path = tmp_path / "scores.csv"
    run_loop(load_config(None, (f"source.uri={sparse_uri}", "run.realtime=false")), practice=str(path))
    (row,) = path.read_text().splitlines()[1:]
    _, procedure, score_s, completion_s, theta_deg, contacts = row.split(",")
    assert (procedure, contacts) == ("subretinal_injection", "1")
    assert float(score_s) == pytest.approx(float(completion_s) + float(theta_deg) + 10, abs=0.02)
    assert "--practice FILE" in call("live", "--help").output
