"""A small study of people with planted names, contacts, words and recordings, none of which may be published."""

import random
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

from protocols import SMALL

from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.runner import Session, open_session
from haptigraph.study.store import Store

__all__ = ["PSEUDONYMS", "SECRETS", "WORDS", "planted_study"]

PSEUDONYMS = [f"P{number:02}" for number in range(1, 8)]
WORDS = {name: f"I am {name.lower()}-Anna and play the bassoon" for name in PSEUDONYMS}
"""What each participant writes."""
NOTE, REASON, STATION = "Anna Meier sneezed", "Anna dropped the pad", "annas-laptop"
CONTACTS = ("meier@eye-clinic.example", "+49 89 1234-567")
SECRETS = [NOTE, REASON, STATION, *CONTACTS, "bassoon", "2026-11-2", "/study.db"]
FREE = '[questionnaire]\nname = "free"\ntitle = "Free"\nintro = "Mail meier@eye-clinic.example"\n'
FREE += '[[item]]\nkey = "words"\ntext = "Who are you?"\nkind = "text"\n'
TEXT = SMALL.replace("participants = 4", "participants = 12").replace("repetitions = 2", "repetitions = 1")
TEXT = TEXT.replace("touch = false", 'procedure = "own.toml"\ntouch = false')
TEXT = TEXT.replace('"Hit the target."', f'"Hit the target. Ask {CONTACTS[0]}, {CONTACTS[1]}."')
for file, when in (("demographics", "start"), ("free.toml", "start"), ("sharing", "end")):
    TEXT += f'\n[[questionnaire]]\nfile = "{file}"\nwhen = "{when}"\n'


class Clock:
    """Every call is half a second later."""

    def __init__(self) -> None:
        self.at = datetime(2026, 11, 21, 9, tzinfo=UTC)

    def __call__(self) -> datetime:
        self.at += timedelta(seconds=0.5)
        return self.at


def planted_study(folder: Path, quick_uri: str = "") -> Path:
    """Write the study; with a source, P01 and P02 have a recording each, and P01 allows all to be published.

    P01 to P04 complete it, P05 withdraws in the middle, P06 never consents, P07 withdraws and is erased.
    """
    folder.mkdir()
    (folder / "study.toml").write_text(TEXT)
    (folder / "free.toml").write_text(FREE)
    (folder / "own.toml").write_text(assemble.load_procedure("subretinal_injection").text)
    chance = random.Random(3)
    with closing(Store(folder / "study.db", Clock())) as store:
        study = Study(load_protocol(folder), store)
        for name in PSEUDONYMS:
            session = open_session(study, study.enrol(), STATION)
            session.note(NOTE)
            while (stage := session.next().stage) is not None:
                if (name == "P06" and stage.kind == "consent") or (name == "P05" and stage.kind == "trial"):
                    break
                if stage.is_trial:
                    _try(session, quick_uri if name in ("P01", "P02") else "", chance)
                    continue
                if stage.kind == "questionnaire":
                    _answer(session, stage, chance)
                session.done(stage.key)
            session.close()
        for name in ("P05", "P07"):
            study.withdraw(name)
    return folder


def _try(session: Session, quick_uri: str, chance: random.Random) -> None:
    stage = session.next().stage
    assert stage is not None
    measures = {
        "completion_s": chance.gauss(40, 5),
        "mean_theta_deg": chance.gauss(5, 1),
        "time_misaligned_retinal_approach_s": chance.gauss(9, 1),
        "contacts": 0,
        "state_order": "aligned_retinal_approach>target_hit",
    }
    if stage.position == 1:
        session.begin_trial(stage.key, records=False)
        session.end_trial("aborted", void=REASON)
    is_recorded = bool(quick_uri) and stage.position == 2
    if is_recorded:
        config = session.config(load_config(None, [f"source.uri={quick_uri}", "run.realtime=false"]))
        session.begin_trial(stage.key)
        assemble.build(config).run()
    else:
        session.begin_trial(stage.key, records=False)
    session.end_trial("hit", measures=None if is_recorded else measures)


def _answer(session: Session, stage, chance: random.Random) -> None:
    for item in session.study.protocol.questionnaire(stage.questionnaire).items:
        given = {"scale": str(chance.randint(1, 5)), "number": "30", "text": WORDS[session.participant]}
        answer = given.get(item.kind) or item.choices[0]
        if item.shares:
            answer = "both" if session.participant == "P01" else "neither"
        if item.key == "age_years" and session.participant == "P02":
            answer = "71"
        session.answer(stage.key, item.key, answer)
