import pytest
from sqlalchemy import select
from walking import go_to

from haptigraph.errors import BadInput
from haptigraph.study.erasure import undo_enrolment
from haptigraph.study.runner import open_session
from haptigraph.study.station import without_consent
from haptigraph.study.tables import METADATA, PARTICIPANTS


def test_an_undone_enrolment_leaves_nothing_and_its_place_is_free(study):
    study.enrol()
    for station in ("one", "two"):
        open_session(study, study.enrol("P07") if station == "one" else "P07", station, take_over=True)
    open_session(study, "P07", "two").done("briefing")
    undo_enrolment(study, "P07")
    for table in METADATA.sorted_tables:
        if "participant" in table.c:
            assert [row for row in study.store.rows(select(table)) if row["participant"] == "P07"] == []
    assert study.enrol("P07") == "P07"
    assert [row["slot"] for row in study.participants()] == [0, 1]
    undo_enrolment(study, "P01")
    assert study.enrol() == "P01"
    assert {row["participant"]: row["slot"] for row in study.participants()} == {"P01": 0, "P07": 1}


def test_the_undone_enrolment_of_everybody_unfreezes_the_protocol(study):
    undo_enrolment(study, study.enrol())
    assert study.check_frozen() is None


def test_an_enrolment_with_consent_or_data_is_not_undone(study):
    consented, noted, left = (open_session(study, study.enrol(), station) for station in "abc")
    go_to(consented, "training")
    noted.note("did not come")
    study.withdraw(left.participant)
    for name, reason in {"P01": "has consented", "P02": "has events in the", "P03": "has left"}.items():
        with pytest.raises(BadInput, match=f"participant {name} {reason}.*cannot be undone; withdraw"):
            undo_enrolment(study, name)
    with pytest.raises(BadInput, match="has no participant 'P09'"):
        undo_enrolment(study, "P09")
    assert len(study.store.rows(select(PARTICIPANTS))) == 3


def test_who_waits_for_consent_is_known_at_their_station_or_at_all_of_them(study):
    go_to(open_session(study, study.enrol(), "one"), "training")
    open_session(study, study.enrol(), "one")
    open_session(study, study.enrol(), "two")
    study.enrol()
    assert without_consent(study, "one") == ["P02", "P04"]
    assert without_consent(study, "two") == ["P03", "P04"]
