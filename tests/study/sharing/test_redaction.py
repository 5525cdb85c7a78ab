import re
from datetime import datetime, timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.errors import BadInput
from haptigraph.study.data_dictionary import COLUMNS, fields_of
from haptigraph.study.exchange.exporting import ITEMS
from haptigraph.study.questionnaire import load_questionnaire, parse_questionnaire
from haptigraph.study.sharing.redaction import HANDLED, PUBLISHED, redacted, unique_people
from haptigraph.study.sharing.rekeying import new_names, shifted, without_contacts

FREE = '[questionnaire]\nname = "free"\ntitle = "F"\n[[item]]\nkey = "words"\ntext = "?"\nkind = "text"\n'
QUESTIONNAIRES = [
    load_questionnaire("demographics"),
    load_questionnaire("sharing"),
    parse_questionnaire(FREE, "free"),
]
ENROLLED = "2026-11-21T09:00:00.250000+00:00"


def answer(name, questionnaire, item, value):
    at = "2026-11-21T09:10:00+00:00"
    key = {"questionnaire": questionnaire, "item": item, "position": None, "condition": None}
    return {"study": "s", "participant": name, **key, "answer": value, "answered_utc": at, "session": 1}


def tables(answers, **people):
    """The tables of an export; `people` are participants' columns that differ from the usual."""
    rows = [
        {
            "study": "s",
            "participant": name,
            "order": "a>b",
            "slot": number,
            "simulated": 0,
            "withdrawn_utc": None,
        }
        | {"consented_utc": ENROLLED, "enrolled_utc": ENROLLED}
        | {row["item"]: row["answer"] for row in answers if row["participant"] == name}
        | columns
        for number, (name, columns) in enumerate(people.items())
    ]
    items = dict.fromkeys(row["item"] for row in answers)
    facts = [COLUMNS["answers"][6]._replace(table="participants", name=item) for item in items]
    empty = {name: (fields_of(name), []) for name in COLUMNS}
    return {
        **empty,
        "participants": (fields_of("participants") + facts, rows),
        "answers": (fields_of("answers"), answers),
    }


def published(answers, without=(), **people):
    found = tables(answers, **people)
    return redacted(found, QUESTIONNAIRES, {name: name.lower() for name in people}, without)


def words_of(found):
    return [row["answer"] for row in found.tables["answers"][1] if row["item"] == "words"]


@pytest.mark.parametrize(
    ("choice", "shares"), [("neither", 0), ("my words", 1), ("the video", 0), ("both", 1), (None, 0)]
)
def test_free_text_needs_consent(choice, shares):
    asked = [] if choice is None else [answer("P01", "sharing", "publish", choice)]
    found = published([answer("P01", "free", "words", "I am Anna"), *asked], P01={})
    assert words_of(found) == ["I am Anna"] * shares
    (person,) = found.tables["participants"][1]
    assert person["words"] == ("I am Anna" if shares else None)
    columns = [field.name for field in found.tables["participants"][0]]
    assert ("words" in columns) == bool(shares)
    assert found.left_out.get("answers in a participant's own words", 0) == 1 - shares


def test_consent_that_is_asked_for_twice_must_be_given_twice():
    twice = [answer("P01", "sharing", "publish", choice) for choice in ("both", "the video")]
    found = published([answer("P01", "free", "words", "I am Anna"), *twice], P01={})
    assert words_of(found) == []


@pytest.mark.parametrize("person", [{"consented_utc": None}, {"withdrawn_utc": "2026-11-21T10:00:00+00:00"}])
def test_of_whoever_withdrew_or_never_consented_only_the_order_remains(person):
    found = published([answer("P01", "demographics", "age_years", "30")], P01=person, P02={})
    assert found.tables["answers"][1] == [] and found.present == ["P02"]
    first = found.tables["participants"][1][0]
    assert (first["participant"], first["order"], first["age_years"]) == ("p01", "a>b", None)


def test_a_column_is_left_out_on_request_with_its_answers():
    answers = [
        answer("P01", "demographics", "age_years", "30"),
        answer("P01", "demographics", "gender", "male"),
    ]
    found = published(answers, ["age_years"], P01={})
    assert [row["item"] for row in found.tables["answers"][1]] == ["gender"]
    assert "age_years" not in [field.name for field in found.tables["participants"][0]]
    with pytest.raises(BadInput, match="unknown column of participants 'slot'; valid: age_years, gender"):
        published(answers, ["slot"], P01={})


def test_whoever_has_a_unique_combination_of_facts_is_named():
    ages = {"P01": "30", "P02": "30", "P03": "71", "P04": "71"}
    answers = [answer(name, "demographics", "age_years", age) for name, age in ages.items()]
    answers += [
        answer(name, "demographics", "gender", "male" if name == "P04" else "female") for name in ages
    ]
    answers += [answer(name, "sharing", "publish", "both") for name in ("P01",)]
    found = published(answers, **{name: {} for name in ages})
    assert unique_people(found.tables, QUESTIONNAIRES) == (["age_years", "gender"], ["p03", "p04"])
    assert unique_people(published([], P01={}).tables, QUESTIONNAIRES) == ([], [])


def test_every_column_of_text_is_decided_on():
    """A new column of text is not published until it is listed: does it name a person, a place, a moment?"""
    texts = {
        field.name
        for name, fields in COLUMNS.items()
        for field in fields
        if field.kind == "text" and name != ITEMS
    }
    times = {field.name for fields in COLUMNS.values() for field in fields if field.unit == "ISO 8601"}
    assert texts - times - PUBLISHED - HANDLED == {"station", "text"}


@given(st.sets(st.from_regex(r"[A-Z]{1,2}-?[0-9]{1,3}", fullmatch=True), max_size=40))
def test_new_names_are_pseudonyms_that_tell_nothing_of_the_old_ones(pseudonyms):
    names = new_names(sorted(pseudonyms))
    assert len(set(names.values())) == len(pseudonyms)
    for name in names.values():
        assert re.fullmatch(r"[A-Z]{4}[0-9]{4}", name)
        assert not any(old in name for old in pseudonyms if len(old) > 2)


def test_new_names_differ_each_time():
    assert new_names(["P01"]) != new_names(["P01"])


@given(st.timedeltas(timedelta(0), timedelta(days=30)), st.timedeltas(timedelta(0), timedelta(days=30)))
def test_durations_stay_and_dates_go(first, second):
    enrolled = datetime.fromisoformat(ENROLLED)
    person = {"enrolled_utc": ENROLLED}
    moved = [
        datetime.fromisoformat(shifted((enrolled + each).isoformat(), person)) for each in (first, second)
    ]
    assert moved[1] - moved[0] == second - first
    assert shifted(ENROLLED, person) == "2000-01-01T00:00:00.000000+00:00"


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("mail a.meier+study@eye-clinic.example, thanks", 1),
        ("call +49 89 1234-567 or +1 (555) 123 4567.", 2),
        ("along_mm = +3.5; seed = 20261121; at 12:30 from 10-12", 0),
    ],
)
def test_contacts_are_replaced(text, count):
    replaced, found = without_contacts(text)
    assert found == count == replaced.count("(contact left out)")
    assert count or replaced == text
