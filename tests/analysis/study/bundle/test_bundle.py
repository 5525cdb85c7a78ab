"""A bundle: reproduced by its own script, without anything that identifies whoever took part."""

import csv
import hashlib
import re
import shutil
import subprocess
import sys
import venv
from datetime import date
from pathlib import Path

import hatchling.build
import msgspec
import pytest
from helpers import call, refuse
from paths import ROOT
from planted import PSEUDONYMS, SECRETS, WORDS, planted_study

from haptigraph.analysis.study.bundle.environment import requirements
from haptigraph.analysis.study.bundle.reproduce import compared
from haptigraph.recording.journal import complete_records
from haptigraph.recording.reader import RunReader

FOUR = 4  # complete the study


@pytest.fixture(scope="module")
def exported(tmp_path_factory, quick_uri):
    """The study, its bundle, and what was printed."""
    folder = planted_study(tmp_path_factory.mktemp("planted") / "mine", quick_uri)
    assert call("study", "erase", folder, "P07", "--yes").exit_code == 0
    result = call("study", "export", folder, "--osf", "-o", folder / "bundle")
    assert result.exit_code == 0, result.output
    return folder, folder / "bundle", result


@pytest.fixture
def bundle(exported):
    return exported[1]


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def texts(bundle: Path):
    """Yield all that a reader of the bundle can find: texts, and the records of recordings."""
    for path in sorted(path for path in bundle.rglob("*") if path.is_file()):
        yield path.name, path.relative_to(bundle).as_posix()
        if path.suffix == ".mcap":
            for _, record in complete_records(path):
                yield path.name, re.sub(r'"data":"[^"]*"', "", repr(record))  # images
        elif path.suffix not in (".png", ".pdf"):  # drawn from the tables of the bundle
            yield path.name, re.sub(r"data:image/[^\"]*", "", path.read_text("utf-8"))


def names_in(folder: Path) -> dict[str, str]:
    (made,) = msgspec.json.decode((folder / "bundles.json").read_bytes())
    return made["participants"]


def test_nothing_that_identifies_a_participant_is_in_the_bundle(exported):
    folder, bundle, result = exported
    hidden = [
        *PSEUDONYMS,
        *(secret for secret in SECRETS if secret != "bassoon"),
        str(folder),
        f"{date.today()}",
    ]
    hidden += [WORDS[name] for name in PSEUDONYMS if name != "P01"]
    for name, text in texts(bundle):
        found = [secret for secret in hidden if secret in text]
        assert found == [], f"{name}: {found}"
    assert sorted(names_in(folder)) == PSEUDONYMS[:FOUR]
    assert not set(result.output.split()) & set(PSEUDONYMS)


def test_what_a_participant_allows_is_in_the_bundle(exported):
    folder, bundle, result = exported
    sharing = names_in(folder)["P01"]
    written = [row for row in rows(bundle / "tables/answers.csv") if row["item"] == "words"]
    assert [(row["participant"], row["answer"]) for row in written] == [(sharing, WORDS["P01"])]
    (recorded,) = [row for row in rows(bundle / "tables/trials.csv") if row["recording"]]
    path = bundle / recorded["recording"]
    assert recorded["participant"] == sharing == path.parent.name
    assert hashlib.sha256(path.read_bytes()).hexdigest() == recorded["recording_sha256"]
    reader, original = RunReader(path), RunReader(next((folder / "recordings/P01").iterdir()))
    assert (reader.info.participant, reader.info.started_utc[:7]) == (sharing, "2000-01")
    for (capture, step), (other, recorded_step) in zip(reader.records(), original.records(), strict=True):
        assert step == recorded_step and capture.encoded == other.encoded
    left_out = (
        "left out: answers in a participant's own words: 3",
        "left out: recordings (not allowed by their participants): 1",
    )
    assert set(left_out) <= set(result.stdout.splitlines())
    assert "* recordings (not allowed by their participants): 1\n" in (bundle / "README.md").read_text()


def test_rows_reveal_neither_order_nor_time_of_enrolment(exported):
    folder, bundle, _ = exported
    people = rows(bundle / "tables/participants.csv")
    names = [row["participant"] for row in people]
    assert names == sorted(names) and len(set(names)) == len(PSEUDONYMS)
    assert {row["enrolled_utc"] for row in people} == {"2000-01-01T00:00:00.000000+00:00"}
    tables = [rows(table) for table in (bundle / "tables").glob("*.csv")]
    columns = {name for table in tables for row in table[:1] for name in row}
    assert not columns & {"slot", "seed", "station", "text"}
    assert {row["void"] for row in rows(bundle / "tables/trials.csv")} == {"", "reason left out"}
    with_data = {row["participant"] for row in rows(bundle / "tables/stages.csv")}
    assert with_data == set(names_in(folder).values())
    withdrawn = [row for row in people if row["withdrawn_utc"]]
    assert [row["withdrawn_utc"] == row["enrolled_utc"] for row in withdrawn].count(True) == 1
    assert not any(row["age_years"] for row in people if row["participant"] not in with_data)


def test_the_script_reproduces_the_report_byte_for_byte_anywhere(bundle, tmp_path):
    moved = shutil.copytree(bundle, tmp_path / "elsewhere")
    command = [sys.executable, "reproduce.py", "new"]
    done = subprocess.run(command, cwd=moved, capture_output=True, text=True)
    count = sum(path.is_file() for path in (bundle / "report").rglob("*"))
    figures = {path.name for path in (bundle / "report" / "figures").iterdir()}
    names = {name.removesuffix(".svg") for name in figures if name.endswith(".svg")}
    assert names and {f"{name}.{ending}" for name in names for ending in ("png", "svg", "pdf")} <= figures
    assert done.stdout == f"{count} files: {count} identical\nthe results are reproduced\n", done.stderr
    assert done.returncode == 0
    lines = (bundle / "SHA256SUMS").read_text().splitlines()
    listed = {name: digest for digest, name in (line.split("  ") for line in lines)}
    for path in (path for path in bundle.rglob("*") if path.is_file() and path.name != "SHA256SUMS"):
        assert hashlib.sha256(path.read_bytes()).hexdigest() == listed.pop(
            path.relative_to(bundle).as_posix()
        )
    assert listed == {}


@pytest.mark.parametrize(
    ("published", "new", "verdict"),
    [
        ("p\n0.123456789\n", "p\n0.123456789\n", "identical"),
        ("p\n0.123456789\n", "p\n0.1234567891\n", "equal"),
        ("p\n0.123456789\n", "p\n0.1235\n", "different"),
        ("p\n0.5\n", "p\n0.5\n0.5\n", "different"),
        ("p\nyes\n", "p\nno\n", "different"),
        ("p\n0.5\n", None, "missing"),
    ],
)
def test_tables_are_compared_number_by_number(tmp_path, published, new, verdict):
    (tmp_path / "a.csv").write_text(published)
    if new is not None:
        (tmp_path / "b.csv").write_text(new)
    assert compared(tmp_path / "a.csv", tmp_path / "b.csv") == verdict


def test_the_bundle_describes_itself(bundle):
    items = rows(bundle / "tables" / "questionnaire_items.csv")
    assert {(row["questionnaire"], row["when"]) for row in items} == {
        *(("demographics", "start"), ("free", "start"), ("sus", "condition"), ("sharing", "end")),
    }
    sus = next(row for row in items if row["questionnaire"] == "sus")
    assert (sus["low"], sus["low_label"], sus["high_label"]) == ("1.0", "Strongly disagree", "Strongly agree")
    assert "no errors" in call("study", "check", bundle / "protocol").stdout
    readme = (bundle / "README.md").read_text()
    for sentence in (
        "not a medical device",
        "choose one before you publish",
        "Participants: 4; recordings: 1",
    ):
        assert re.sub(r"\s+", " ", sentence) in re.sub(r"\s+", " ", readme)
    assert "12 participants" in (bundle / "preregistration.md").read_text()
    assert "Python: CPython" in (bundle / "environment.txt").read_text()
    assert re.search(r"^scipy==1\.", (bundle / "requirements.txt").read_text(), re.MULTILINE)
    assert requirements().startswith("haptigraph[study]==")


def test_a_unique_combination_of_facts_is_a_warning(exported):
    folder, bundle, result = exported
    name = names_in(folder)["P02"]
    assert "1 of 4 participants: nobody else has their combination of age_years, game_hours" in result.stderr
    assert result.stderr.strip().endswith(f"They are {name}; leave columns out with --without COLUMN")
    assert "vision nobody else has: 1.**" in (bundle / "README.md").read_text()


def test_erase_and_check_list_the_bundles_that_contain_a_participant(exported):
    folder, bundle, _ = exported
    listed = call("study", "erase", folder, "P01", "--dry-run").stdout
    assert "bundles that contain these data; delete or replace them wherever they are published" in listed
    assert f"  {bundle} (as {names_in(folder)['P01']}; made 20" in listed
    assert "bundle/tables" not in listed
    assert "bundles" not in call("study", "erase", folder, "P05", "--dry-run").stdout
    assert f"bundle {bundle}, 20" in call("study", "check", folder).stdout
    assert call("study", "check", folder).stdout.count("contains data that were erased here") == 0


def test_a_bundle_is_refused_in_one_sentence(exported, tmp_path):
    folder, bundle, _ = exported
    new = tmp_path / "new"
    assert "exists already; an export never overwrites" in refuse(
        "study", "export", folder, "--osf", "-o", bundle
    )
    wrong = refuse("study", "export", folder, "--osf", "-o", new, "--without", "age")
    assert "--without: unknown column of participants 'age'; valid: age_years, game_hours" in wrong
    assert "--without goes with --osf" in refuse(
        "study", "export", folder, "-o", new, "--without", "age_years"
    )
    assert "give --osf or --parquet" in refuse("study", "export", folder, "--osf", "--parquet", "-o", new)
    assert call("study", "new", tmp_path / "empty").exit_code == 0
    assert "the first enrolment creates it" in refuse(
        "study", "export", tmp_path / "empty", "--osf", "-o", new
    )
    before = (folder / "bundles.json").read_bytes()
    (folder / "bundles.json").write_text("[{}]")
    assert "bundles.json: is damaged" in refuse("study", "erase", folder, "P01", "--yes")
    (folder / "bundles.json").write_bytes(before)
    assert not new.exists() and not list(tmp_path.glob(".new*"))


def test_a_study_without_results_is_not_bundled(tmp_path):
    folder = tmp_path / "mine"
    assert call("study", "new", folder).exit_code == 0
    from haptigraph.study.protocol import load_protocol
    from haptigraph.study.roster import Study
    from haptigraph.study.store import Store

    store = Store(folder / "study.db")
    Study(load_protocol(folder), store).enrol()
    store.close()
    message = refuse("study", "export", folder, "--osf", "-o", tmp_path / "new")
    assert "study sight_and_touch: cannot be reported, and so not bundled: contains no trial" in message
    assert {path.name for path in tmp_path.iterdir()} == {"mine"}
    assert not (folder / "bundles.json").exists()


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_bundle_is_reproduced_in_an_empty_environment(bundle, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    wheels = tmp_path / "wheels"
    hatchling.build.build_wheel(str(wheels))
    venv.create(tmp_path / "empty", with_pip=True)
    python = str(tmp_path / "empty" / ("Scripts" if sys.platform == "win32" else "bin") / "python")
    moved = shutil.copytree(bundle, tmp_path / "elsewhere")
    install = [
        python,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--find-links",
        str(wheels),
        "-r",
        "requirements.txt",
    ]
    monkeypatch.delenv("PYTHONPATH", raising=False)
    subprocess.run(install, cwd=moved, check=True)
    done = subprocess.run([python, "-I", "reproduce.py"], cwd=moved, capture_output=True, text=True)
    assert (done.returncode, done.stdout.splitlines()[-1]) == (0, "the results are reproduced"), done.stderr
