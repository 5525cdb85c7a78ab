"""A study that is blind to everyone: what the experimenter receives does not depend on the condition."""

import json
import re
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from types import SimpleNamespace

import pytest
from helpers import call
from studying import PROTOCOL, study_at
from visiting import acknowledge, watching

from haptigraph.config import load_config
from haptigraph.dashboard.server.server import listen
from haptigraph.dashboard.study.service import StudyService
from haptigraph.dashboard.study.site import StudySite
from haptigraph.dashboard.study.snapshots import experimenter_snapshot
from haptigraph.dashboard.study.trial import run_trials
from haptigraph.study.store import Store
from haptigraph.study.tables import TRIALS

BLIND = re.sub(
    r"\[training\][^\[]*|\[\[questionnaire\]\][^\[]*|\[\[target\]\]\nname = \"left\"[^\[]*",
    "",
    PROTOCOL.replace('order = "fixed"', 'order = "balanced"\nblind = "everyone"')
    .replace('display = "overlays"', 'display = "overlays"\nprocedure = "wide.toml"')
    .replace("timeout_s = 300", "timeout_s = 1.5"),
)
"""With touch and without, with and without overlays, under procedures of other thresholds and names."""
OF_THE_MOMENT = re.compile(
    r"number|index|.*_ms|rate_hz|steps|overruns|skipped|viewers|version|hand|recording"
)
OF_ANYONE = re.compile(r"P0\d|20\d\d-\d\d-\d\dT[\d:.+]+|'(version|elapsed_s|slot)': [\d.]+")


@pytest.fixture
def folder(tmp_path, procedure):
    wide = procedure.text.replace("= 1.7", "= 4.0").replace("subretinal_injection", "wide")
    (tmp_path / "wide.toml").write_text(wide)
    (tmp_path / "study.toml").write_text(BLIND)
    return tmp_path


def receive(live, path, outputs, found):
    """Collect the distinct messages of one trial on a page, without numbers and times, by type."""
    with watching(live, path=path, max_queue=None) as line:
        line.send(json.dumps({"type": "outputs", "names": outputs}))
        while "ended" not in found:
            message = line.recv(timeout=20)
            if isinstance(message, bytes):
                content, picture = acknowledge(line, message)
                found.setdefault("picture", {})[content["index"]] = picture
            else:
                content = json.loads(message)
            words = {name: value for name, value in content.items() if not OF_THE_MOMENT.fullmatch(name)}
            found.setdefault(content["type"], set()).add(json.dumps(words, sort_keys=True))


def own_snapshot(service):
    """Return what the experimenter's page shows, without the participants before."""
    snapshot = experimenter_snapshot(service)
    return {**snapshot, "participants": snapshot["participants"][-1:]}


def first_trial(service, base, monkeypatch):
    """Perform the first trial of the next participant.

    Returns:
        What the experimenter's and the participant's page received, and everything else that is shown.
    """
    service.open(service.enrol(None), take_over=False)
    session, shown, lab, person = service.session, [], {}, {}
    for key in ("briefing", "consent"):
        session.done(key)
    with closing(listen("127.0.0.1", 0)) as listener, ThreadPoolExecutor(2) as pool:
        site = StudySite(service, base, listener, host="127.0.0.1", token="")
        with site.served():
            live = SimpleNamespace(url=site.addresses()[0])
            pages = [
                pool.submit(receive, live, path, outputs, found)
                for path, outputs, found in (
                    ("/live", [], lab),
                    ("/participant/live", ["screen"], person),
                )
            ]
            while not ("health" in lab and "health" in person and service.touch.name):
                assert not any(page.done() for page in pages)
            shown.append(own_snapshot(service))
            session.answer_pulse("screen", is_felt=True)
            service.begin(session.participant, "trial/1/1/1")
            shown.append(own_snapshot(service))
            requested = iter([service.next_trial()])
            monkeypatch.setattr(service, "next_trial", lambda: next(requested))
            with pytest.raises(StopIteration):
                run_trials(service, site, base, shown.append)
            monkeypatch.undo()
            for page in pages:
                page.result()
    shown.append(own_snapshot(service))
    return lab, person, OF_ANYONE.sub("...", repr(shown))


def test_nothing_that_the_experimenter_receives_depends_on_the_condition(folder, quick_uri, monkeypatch):
    # A busy machine may make images late: a fault in one of the two trials alone.
    base = load_config(None, (f"source.uri={quick_uri}", "run.stale_ms=60000"))
    with closing(Store(folder / "study.db")) as store:
        service = StudyService(folder, study_at(folder, store), "lab 1")
        (lab, person, shown), (other_lab, other_person, other_shown) = (
            first_trial(service, base, monkeypatch) for _ in range(2)
        )
        conditions = [row["condition"] for row in store.rows(TRIALS.select().order_by(TRIALS.c.participant))]
    assert sorted(conditions) == ["felt", "seen"]
    assert person["hello"] != other_person["hello"] and person["haptics"] != other_person["haptics"]
    assert "haptics" not in lab and len(lab["image"]) == 1
    pictures, other_pictures = lab.pop("picture"), other_lab.pop("picture")
    common = pictures.keys() & other_pictures.keys()
    assert common and all(pictures[index] == other_pictures[index] for index in common)
    assert lab == other_lab
    assert shown == other_shown


def test_check_and_status_list_assignments_only_when_unblinded(folder):
    with closing(Store(folder / "study.db")) as store:
        study_at(folder, store).enrol()
    for command in ("check", "status"):
        blinded, unblinded = call("study", command, folder), call("study", command, folder, "--unblind")
        assert blinded.exit_code == unblinded.exit_code == 0
        assert "blinded: --unblind shows who gets which condition" in blinded.output
        assert "UNBLINDED: whoever reads this knows who gets which condition" in unblinded.output
        assert "felt > seen" in unblinded.output or "seen > felt" in unblinded.output
        assert not re.search("(felt|seen) > |trial/1/1/1 +.? +(felt|seen)", blinded.output)
    assert "Plan of the first participant" not in call("study", "check", folder).output
