"""Two stations, each a `haptigraph study run` of its own, lead participants at the same time."""

from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import postgres
import pytest
from studying import PROTOCOL, Station, ask_at, study_at

from haptigraph.study.recordings import recorded_trials, whats_wrong
from haptigraph.study.standing import standings
from haptigraph.study.store import Store
from haptigraph.study.tables import ANSWERS, TRIALS

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


def asked(station, path, **content):
    status, answer = ask_at(station, path, content or None)
    assert status == 200, answer
    return answer


def lead(station):
    """Take someone in and lead them to the end, as the pages do; return who it was."""
    name = asked(station, "/study/enrol", participant="")["here"]["participant"]
    while stage := (now := asked(station, "/participant/now")).get("stage"):
        here = {"participant": name, "key": stage["key"]}
        if now["doing"]:
            continue
        if "display" in stage:
            asked(station, "/participant/begin", **here)
            continue
        for item in stage.get("items", ()):
            answer = item["choices"][0] if item["choices"] else "30" if item["kind"] == "number" else "4"
            asked(station, "/participant/answer", **here, item=item["key"], answer=answer)
        asked(station, "/participant/done", **here)
    assert now["ended"] == "all is done"
    return name


def test_two_stations_at_one_postgresql_do_not_collide(quick_uri, tmp_path):
    """Each with a folder of its own, as on two computers; both freeze the protocol and take in at once."""
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
            led = pool.map(lambda station: [lead(station), lead(station)], (one, two))
            names = [name for names in led for name in names]
            for station in (one, two):
                assert "Traceback" not in station.stop()
        with closing(Store(url)) as store:
            study = study_at(folders[0], store)
            assert sorted(names) == ["P01", "P02", "P03", "P04"]
            assert sorted(row["slot"] for row in study.participants()) == [0, 1, 2, 3]
            assert {(each.next.ended, each.station, each.void) for each in standings(study)} == {
                ("all is done", "", 0)
            }
            trials = store.rows(TRIALS.select())
            assert Counter(row["participant"] for row in trials) == dict.fromkeys(names, 3)
            assert {row["outcome"] for row in trials} == {"timeout"}
            assert Counter(row["participant"] for row in store.rows(ANSWERS.select())) == dict.fromkeys(
                names, 28
            )
            wrong = [
                {whats_wrong(trial, folder) for folder in folders}
                for trial in recorded_trials(store, "short")
            ]
            assert len(wrong) == 12 and all(
                "" in each and len(each) == 2 for each in wrong
            )  # whole, at one of them
