"""Two stations, each a `haptigraph study run` of its own, serve participants at the same time."""

from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import postgres
import pytest
from studying import PROTOCOL, Station, feel_pulse, page_with_outputs, send_to, study_at

from haptigraph.study.recordings import recorded_trials, recording_problem
from haptigraph.study.status import participant_statuses
from haptigraph.study.store import Store
from haptigraph.study.tables import ANSWERS, TRIALS

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


def send(station, path, **content):
    status, answer = send_to(station, path, content or None)
    assert status == 200, answer
    return answer


def complete_study(station):
    """Enrol a participant and complete all stages, as the pages do; return their name."""
    with page_with_outputs(station, "screen"):
        return complete_stages(station)


def complete_stages(station):
    name = send(station, "/study/enrol", participant="")["current"]["participant"]
    while stage := (status := send(station, "/participant/status")).get("stage"):
        here = {"participant": name, "key": stage["key"]}
        if status["trial_status"]:
            continue
        if "display" in stage:
            feel_pulse(station, here)
            send(station, "/participant/begin", **here)
            continue
        for item in stage.get("items", ()):
            answer = item["choices"][0] if item["choices"] else "30" if item["kind"] == "number" else "4"
            send(station, "/participant/answer", **here, item=item["key"], answer=answer)
        send(station, "/participant/done", **here)
    assert status["ended"] == "all is done"
    return name


def test_two_stations_at_one_postgresql_do_not_collide(quick_uri, tmp_path):
    """Each with a folder of its own, as on two computers; both freeze the protocol and enrol at once."""
    if postgres.BINARIES is None:
        pytest.skip("no PostgreSQL server here (apt-get install postgresql)")
    text = PROTOCOL.replace("timeout_s = 300", "timeout_s = 1").replace(
        "participants = 3", "participants = 4"
    )
    folders = [tmp_path / name for name in ("one", "two")]
    for folder in folders:
        folder.mkdir()
        (folder / "study.toml").write_text(text)
    with postgres.postgres() as url:
        more = ("--store", url)
        with (
            Station(folders[0], quick_uri, *more, station="lab 1") as one,
            Station(folders[1], quick_uri, *more, station="lab 2") as two,
            ThreadPoolExecutor(2) as pool,
        ):
            led = pool.map(lambda station: [complete_study(station), complete_study(station)], (one, two))
            names = [name for names in led for name in names]
            for station in (one, two):
                assert "Traceback" not in station.stop()
        with closing(Store(url)) as store:
            study = study_at(folders[0], store)
            assert sorted(names) == ["P01", "P02", "P03", "P04"]
            assert sorted(row["slot"] for row in study.participants()) == [0, 1, 2, 3]
            assert {(each.next.ended, each.station, each.void) for each in participant_statuses(study)} == {
                ("all is done", "", 0)
            }
            trials = store.rows(TRIALS.select())
            assert Counter(row["participant"] for row in trials) == dict.fromkeys(names, 3)
            assert {row["outcome"] for row in trials} == {"timeout"}
            assert Counter(row["participant"] for row in store.rows(ANSWERS.select())) == dict.fromkeys(
                names, 28
            )
            wrong = [
                {recording_problem(trial, folder) for folder in folders}
                for trial in recorded_trials(store, "short")
            ]
            assert len(wrong) == 12 and all(
                "" in each and len(each) == 2 for each in wrong
            )  # complete at one of them
