import csv
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import call, refuse
from msgspec.structs import replace

import haptigraph
from haptigraph.assemble import load_procedure
from haptigraph.recording.journal import Journal
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import RunWriter
from haptigraph.version import __version__

COMMANDS = [
    "archive", "batch", "check", "demo", "devices", "diagram", "evaluate", "evidence", "explain", "figure", "live", "procedure", "query", "recover", "register", "replay", "run", "sources",
    "study", "touch",
]  # fmt: skip


def test_help_lists_every_command():
    text = call("--help").output
    assert "not a medical device" in text
    for command in COMMANDS:
        assert re.search(rf"^  {command} ", text, re.MULTILINE)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command):
    result = call(command, "--help")
    assert result.exit_code == 0
    assert len(result.output.splitlines()) > 5


def test_help_imports_nothing_heavy():
    code = "import sys, haptigraph.cli; print(*(m for m in ('numpy', 'cv2', 'matplotlib', 'rich', 'mcap', 'starlette', 'uvicorn', 'pydicom', 'pyrealsense2', 'cyclonedds', 'pylsl', 'foxglove', 'sqlalchemy', 'pandas', 'distributed', 'pyarrow', 'duckdb') if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


@pytest.fixture(scope="module")
def recording(quick_uri, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("cli") / "run.mcap"
    result = call("run", quick_uri, "--fast", "--record", path)
    assert result.exit_code == 0
    return path


def test_run_prints_states_and_a_summary(sparse_uri, tmp_path):
    trace = tmp_path / "touch.csv"
    result = call("run", sparse_uri, "--fast", "--device", f"trace:{trace}", "--set", "trial.participant=P1")
    assert result.exit_code == 0
    assert "retinal_contact" in result.stderr
    for text in (
        "target hit after",
        "mean theta",
        "contacts        1 unintended",
        "overruns",
        "p50",
        "source ended",
    ):
        assert text in result.stdout
    with trace.open() as file:
        amplitudes = {float(row["amplitude"]) for row in csv.DictReader(file)}
    assert amplitudes == {0.0, 0.3, 0.8, 1.0}
    assert trace.with_suffix(".png").exists()


def test_replay_finds_every_step_identical(recording):
    result = call("replay", recording)
    assert result.exit_code == 0
    assert "117 of 117 steps identical" in result.output


def test_replay_under_another_procedure_says_what_differs_and_where_to_see_it(recording, procedure, tmp_path):
    other = tmp_path / "other.toml"
    other.write_text(procedure.text.replace("at_most = 5.5", "at_most = 9.0"))
    result = call("replay", recording, "--procedure", other)
    assert result.exit_code == 0
    states, identical, first, *_ = result.output.splitlines()
    lasts_s = re.fullmatch(
        r"states differ for ([\d.]+) s in \d+ of 117 steps, first at [\d.]+ s \(step \d+\): "
        r"misaligned_retinal_approach instead of misaligned_intraocular_navigation",
        states,
    )[1]
    assert identical == "haptic output differs in no step"
    assert re.match(
        r"\d+ of 117 steps identical; the others differ at least in a relation or a number", first
    )
    assert "first difference: step" in result.output
    assert "edges needle_tip approaching retina_surface" in result.output
    assert "{" not in result.output  # no raw JSON
    near = re.search(
        r"^state misaligned retinal approach +([\d.]+) s +([\d.]+) s +\*$", result.output, re.MULTILINE
    )
    assert 0 < float(near[2]) - float(near[1]) <= float(lasts_s)
    assert re.search(r"^completion time .*[^*]$", result.output, re.MULTILINE)
    assert "not exercised" in result.output or "kept" in result.output
    assert f"haptigraph live --recordings {recording.parent} --port 8765" in result.output
    assert "http://127.0.0.1:8765/recordings#run.mcap" in result.output
    assert "copy other.toml into" in result.output
    shipped = call("replay", recording, "--procedure", "subretinal_injection_cautious").output
    assert "http://127.0.0.1:8765/recordings#run.mcap?step=" in shipped
    assert "&with=subretinal_injection_cautious" in shipped


def test_a_replay_that_differs_exits_with_1(recording, monkeypatch):
    from haptigraph.haptics.renderer import GrammarRenderer
    from haptigraph.messages import OFF, HapticCommand

    monkeypatch.setattr(GrammarRenderer, "__call__", lambda self, c: HapticCommand(c.stamp_ns, OFF, 0))
    result = call("replay", recording)
    assert result.exit_code == 1
    assert "command" in result.output
    assert re.search(
        r"^haptic output differs for [\d.]+ s in \d+ of 117 steps, first at [\d.]+ s \(step \d+\): off instead of low$",
        result.output,
        re.MULTILINE,
    )
    assert "last digits" not in result.output


def test_a_replay_that_differs_in_last_digits_says_so_and_exits_with_1(recording, monkeypatch):
    from haptigraph.scene.builder import SchemaSceneBuilder

    build = SchemaSceneBuilder.__call__

    def rounded(self, observation):
        graph = build(self, observation)
        return replace(graph, measures={name: value + 2e-9 for name, value in graph.measures.items()})

    monkeypatch.setattr(SchemaSceneBuilder, "__call__", rounded)
    result = call("replay", recording)
    assert result.exit_code == 1
    assert "numbers differ in their last digits, by at most 2e-09: states and haptic output are the same" in (
        result.output
    )
    assert "recorded  " not in result.output


def test_check_explains_a_procedure():
    result = call("check", "subretinal_injection")
    assert result.exit_code == 0
    assert "misaligned_retinal_approach" in result.output
    assert "all 28 claims proved: looked at all 36 possible graphs" in result.output
    assert "z3" in call("check", "--prover", "z3").output


def test_check_shows_the_smallest_graph_that_violates_a_claim_and_exits_with_1(procedure, tmp_path):
    file, picture = tmp_path / "p.toml", tmp_path / "broken.png"
    file.write_text(procedure.text.replace("above = 1.7", "above = 1.9"))
    result = call("check", file, "--picture", picture)
    assert result.exit_code == 1
    assert "where 1.7 < theta_deg <= 1.9, neither <needle_line, aligned, retina_target>" in result.output
    assert "no rule fits this graph" in result.output
    assert "needle_tip ──inside──▶ eye_globe" in result.output
    assert "VIOLATED" in result.output and "claims proved" not in result.output
    assert picture.stat().st_size > 20_000
    assert "exists already" in refuse("check", file, "--picture", picture)
    assert "valid endings: .png, .svg, .pdf" in refuse("check", file, "--picture", tmp_path / "p.xyz")
    assert "cannot be read" in refuse("check", tmp_path / "none.toml")


def test_explain_prints_rule_evidence_and_runner_up(recording):
    text = call("explain", recording, "--at", 3)
    assert text.exit_code == 0
    assert "fired by" in text.output and "runner-up" in text.output and "graph: " in text.output
    as_json = json.loads(call("explain", recording, "--at", 3, "--json").output)
    assert f"{as_json['time_s']:.2f} s  {as_json['state']}, rule {as_json['priority']}" in text.output
    assert as_json["runner_up"]["state"] != as_json["state"]
    for wrong in (-1, 500):
        assert f"has no step at {wrong} s; valid: 0 to " in refuse("explain", recording, "--at", wrong)


def test_explain_without_a_moment_says_what_a_recording_is(recording, quick_uri):
    lines = call("explain", recording).output.splitlines()
    for line in (
        f"recording       {recording}, complete",
        f"source          {quick_uri}, 15 images/s",
        "perceiver       tracker",
        "setting         run.realtime=false",
        "ground truth    recorded: it is of a simulation",
    ):
        assert line in lines
    facts = json.loads(call("explain", recording, "--json").output)
    assert facts["version"] == __version__ and facts["steps"] == len(RunReader(recording))
    assert facts["procedure_sha256"] == load_procedure("subretinal_injection").sha256
    assert facts["dropped_images"] == 0


def test_diagram_writes_an_svg_and_overwrites_none(tmp_path):
    file = tmp_path / "states.svg"
    assert call("diagram", "-o", file).exit_code == 0
    assert file.read_text().startswith("<svg")
    assert "exists already" in refuse("diagram", "-o", file)
    assert "valid ending: .svg" in refuse("diagram", "-o", tmp_path / "states.png")


def test_recover_repairs_a_truncated_recording(recording, tmp_path):
    truncated = tmp_path / "truncated.mcap"
    truncated.write_bytes(recording.read_bytes()[:-5000])
    result = call("recover", truncated)
    assert result.exit_code == 0
    assert "can be read again up to its end:" in result.output
    assert RunReader(truncated).is_whole
    assert "is complete\n" in call("recover", truncated).output
    assert "steps identical" in call("replay", truncated).output


def test_a_broken_claim_is_printed_behind_the_state_of_its_step(sparse_uri, tmp_path):
    text = Path(haptigraph.__file__).with_name("procedures").joinpath("subretinal_injection.toml").read_text()
    strict = tmp_path / "strict.toml"
    strict.write_text(text.replace("most_changes = 6", "most_changes = 1"))
    lines = call("run", sparse_uri, "--fast", "--procedure", strict).output.splitlines()
    broken = [number for number, line in enumerate(lines) if "! violated: " in line]
    assert broken
    for number in broken:
        following = [
            line for line in lines[number + 1 :] if line.startswith(lines[number].split(" s ")[0] + " s ")
        ]
        assert all("! violated: " in line for line in following)


def test_a_recorder_that_failed_is_reported_by_every_command(sparse_uri, tmp_path, monkeypatch):
    append, path = RunWriter.write, tmp_path / "run.mcap"

    def write(writer, capture, step, **options):
        if writer.steps == 20:
            raise TypeError("no number")
        append(writer, capture, step, **options)

    monkeypatch.setattr(RunWriter, "write", write)
    assert call("run", sparse_uri, "--fast", "--record", path).exit_code == 2
    lost = "the recorder failed after step 19 (TypeError: no number); later steps are lost"
    assert f"{path}, {lost}; `haptigraph recover` repairs the file\n" in call("explain", path).output
    assert "none in these steps" in call("explain", path).output
    assert lost in call("evaluate", path).output
    assert lost in call("replay", path).output
    for said in ("can be read again up to its end: 20 steps", "can be read"):
        recovered = call("recover", path)
        assert (recovered.exit_code, recovered.output) == (1, f"{path} {said}\n{lost}\n")
        assert f"{path}, recovered; {lost}\n" in call("explain", path).output


def test_replay_reports_an_interrupted_recording(recording, tmp_path):
    truncated = tmp_path / "truncated.mcap"
    truncated.write_bytes(recording.read_bytes()[:-5000])
    assert "was interrupted; `haptigraph recover` repairs it" in call("replay", truncated).output


def test_a_recording_in_progress_is_replayed_so_far_but_not_recovered(recording, tmp_path):
    live = tmp_path / "live.mcap"
    journal = Journal(os.open(live, os.O_WRONLY | os.O_CREAT))
    journal.write(recording.read_bytes()[:-5000])
    assert "the recording is still being written" in call("replay", live).output
    assert refuse("recover", live) == f"haptigraph: {live}: is still being written; end that run first"
    journal.close()


def test_demo_runs_records_replays_and_draws(quick, tmp_path):
    result = call("demo", "--fast", "--scenario", quick, "--output", tmp_path)
    assert result.exit_code == 0
    assert "replayed        117 of 117 steps identical" in result.output
    assert str(tmp_path / "demo.png") in result.output
    assert (tmp_path / "demo.png").stat().st_size > 50_000
    assert RunReader(tmp_path / "demo.mcap").is_whole


def test_a_recording_into_a_folder_that_does_not_exist_names_the_folder(quick_uri, tmp_path):
    path = tmp_path / "runs" / "run.mcap"
    problem = f"cannot be written: there is no folder {path.parent}; create it first"
    assert refuse("run", quick_uri, "--fast", "--record", path) == f"haptigraph: {path}: {problem}"


def test_sources_lists_syntax_and_missing_extras(monkeypatch):
    from haptigraph.sources import available

    result = call("sources")
    assert result.exit_code == 0
    for syntax in ("phantom[:SCENARIO]", "camera:N", "realsense[:SERIAL]", "FILE.dcm", "FILE.mcap", "FOLDER"):
        assert re.search(rf"^{re.escape(syntax)} .*\w", result.output, re.MULTILINE)
    assert re.search(r"^soft_retina +The needle presses on the target", result.output, re.MULTILINE)
    monkeypatch.setattr(available, "find_spec", lambda name: None)
    monkeypatch.setattr(available, "connected_cameras", lambda: [("camera:2", "Microscope")])
    output = call("sources").output
    assert "pip install 'haptigraph[dicom]'" in output
    assert output.count("pip install 'haptigraph[realsense]'") == 2
    assert re.search(r"connected cameras\ncamera:2 +Microscope\n$", output)


# --- bad input: one sentence, exit code 2, nothing overwritten


def test_a_bad_registration_is_one_sentence(quick_uri, tmp_path):
    file = tmp_path / "eye.toml"
    file.write_text("format = 1\n[image]\nwidth = 10\n")
    message = refuse("run", quick_uri, "--registration", file)
    assert message == f"haptigraph: {file}, line 2: image: key 'height' is missing"


def test_a_bad_procedure_is_one_sentence(quick_uri, procedure, tmp_path):
    file = tmp_path / "p.toml"
    file.write_text(procedure.text.replace('feel = "pulse"', 'feel = "plse"'))
    for command in (("check", file), ("run", quick_uri, "--procedure", file)):
        assert "unknown pattern 'plse'; did you mean 'pulse'?" in refuse(*command)


def test_a_bad_configuration_is_one_sentence(quick_uri, tmp_path):
    file = tmp_path / "lab.toml"
    file.write_text("[haptics]\ndeadman = 100\n")
    message = refuse("run", quick_uri, "--config", file)
    assert message.startswith(
        f"haptigraph: {file}, line 2: unknown key 'deadman'; did you mean 'deadman_ms'?"
    )
    assert "--set: perception.alpha: expected float <= 1.0, found 9" in refuse(
        "run", quick_uri, "--set", "perception.alpha=9"
    )


def test_a_bad_video_is_one_sentence(tmp_path, registration_toml):
    file, eye = tmp_path / "clip.mp4", tmp_path / "eye.toml"
    file.write_bytes(b"no video")
    eye.write_text(registration_toml)
    command = [sys.executable, "-m", "haptigraph", "run", str(file), "--registration", str(eye)]
    done = subprocess.run(
        command, capture_output=True, text=True
    )  # in another process, for OpenCV's log messages
    assert done.returncode == 2
    assert re.fullmatch(r"haptigraph: .*clip\.mp4: not a video that OpenCV can read.*\n", done.stderr)
    assert "file not found" in refuse("run", tmp_path / "gone.mp4", "--registration", eye)


def test_images_of_another_size_than_registered_are_one_sentence(quick_uri, tmp_path, registration_toml):
    eye = tmp_path / "eye.toml"
    eye.write_text(registration_toml)
    record = tmp_path / "run.mcap"
    result = call("run", quick_uri, "--fast", "--registration", eye, "--record", record)
    assert result.exit_code == 2
    assert "image is 480 x 270 px, but the registration is for 320 x 240 px" in result.stderr
    assert not record.exists()


def test_a_bad_recording_is_one_sentence(tmp_path):
    file = tmp_path / "run.mcap"
    file.write_bytes(b"nothing")
    for command in ("replay", "recover", "run"):
        assert "run.mcap: not a recording" in refuse(command, file)
    assert file.read_bytes() == b"nothing"


def test_a_missing_camera_and_a_missing_clip_are_one_sentence(tmp_path, registration_toml):
    eye = tmp_path / "eye.toml"
    eye.write_text(registration_toml)
    assert "camera:9 cannot be opened" in refuse("run", "camera:9", "--registration", eye)
    assert "clip.mp4, registration.toml and truth.csv are missing" in refuse("evaluate", tmp_path)


@pytest.mark.parametrize(
    ("module", "extra", "source"),
    [
        ("pyrealsense2", "realsense", "realsense"),
        ("pyrealsense2", "realsense", "run.db3"),
        ("pydicom", "dicom", "scan.dcm"),
    ],
)
def test_a_missing_extra_is_named_in_one_sentence(
    monkeypatch, tmp_path, registration_toml, module, extra, source
):
    eye, file = tmp_path / "eye.toml", tmp_path / source
    eye.write_text(registration_toml)
    file.write_bytes(b"something")
    monkeypatch.setitem(sys.modules, module, None)
    message = refuse("run", source if source == "realsense" else file, "--registration", eye)
    assert message.endswith(f"install it with: pip install 'haptigraph[{extra}]'")


def test_the_phantom_runs_without_any_extra(sparse_uri):
    extras = ("pyrealsense2", "pydicom", "cyclonedds", "pylsl", "foxglove", "serial", "sdl2", "sounddevice")
    hidden = (*extras, "pyigtl", "z3", "networkx", "av")
    code = f"import sys; sys.modules.update(dict.fromkeys({hidden})); from haptigraph.cli import main; main()"
    command = [sys.executable, "-c", code, "run", sparse_uri, "--fast"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "source ended" in done.stdout


def test_nothing_is_overwritten(quick_uri, tmp_path):
    for option, name in (("--record", "run.mcap"), ("--device", "touch.csv")):
        file = tmp_path / name
        file.write_text("precious")
        value = f"trace:{file}" if option == "--device" else file
        assert "exists already" in refuse("run", quick_uri, "--fast", option, value)
        assert file.read_text() == "precious"


def test_the_demo_overwrites_no_figure_and_a_wrong_scenario_creates_no_folder(quick, tmp_path):
    assert "unknown scenario 'nothing'" in refuse(
        "demo", "--scenario", "nothing", "--output", tmp_path / "new"
    )
    assert list(tmp_path.iterdir()) == []
    picture = tmp_path / "demo.png"
    picture.write_text("precious")
    message = refuse("demo", "--fast", "--scenario", quick, "--output", tmp_path)
    assert message == f"haptigraph: {picture}: exists already; the demo never overwrites a file"
    assert list(tmp_path.iterdir()) == [picture]


@pytest.mark.parametrize("command", ["replay", "recover"])
def test_interrupting_a_command_is_reported(recording, monkeypatch, command):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(RunReader, "_groups", interrupted)
    monkeypatch.setattr("haptigraph.recording.recovery.is_whole", interrupted)
    result = call(command, recording)
    assert (result.exit_code, result.stderr) == (130, "haptigraph: stopped\n")


def test_check_does_not_interpret_markup_in_user_text(procedure, tmp_path):
    file = tmp_path / "p.toml"
    file.write_text(
        procedure.text.replace(
            "[[state]]", '[[state]]\nname = "[bold]x[/red]"\nfeel = "low"\nbecause = ""\n[[state]]', 1
        )
        .replace('name = "subretinal_injection"', 'name = "p"\ntitle = "[/red]x :smile:"', 1)
        .replace('\ntitle = "S', '\n# "S', 1)
    )
    result = call("check", file)
    assert result.exit_code == 1  # the first state matches everything
    assert "[/red]x :smile:" in result.output
    assert "[bold]x[/red]" in result.output


def test_check_does_not_wrap_names_outside_a_terminal(procedure, tmp_path):
    file, name = tmp_path / "p.toml", "contact_" + 20 * "very_" + "near_the_retina"
    file.write_text(procedure.text.replace('"retinal_contact"', f'"{name}"'))
    assert name in call("check", file).output


def test_a_damaged_recording_is_an_error(recording, tmp_path):
    data = bytearray(recording.read_bytes())
    data[len(data) // 2] ^= 0xFF
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data)
    assert "damaged.mcap, byte" in refuse("replay", damaged)
    result = call("recover", damaged)
    saved = tmp_path / "damaged.recovered.mcap"
    assert result.exit_code == 1
    assert re.search(r"damaged\.mcap is damaged: \d+ bytes are left out\n  byte \d+: crc of", result.output)
    assert re.search(r"missing: step [\d, -]+ of a damaged recording", result.output)
    assert f"are saved in {saved}; {damaged} is unchanged" in result.output
    assert damaged.read_bytes() == data
    again = call("replay", saved)
    assert "missing: step " in again.output and " 0 steps" not in again.output
    assert "exists already" in refuse("recover", damaged)


@pytest.mark.parametrize("name", ["nofile.mp4", "no/clips", "./eye.png"])
def test_a_file_that_does_not_exist_is_not_found(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for command in (("run", name), ("register", name, "-o", "x.toml")):
        assert (
            refuse(*command)
            == f"haptigraph: {name}: file not found; `haptigraph sources` lists what SOURCE can be"
        )


def test_a_misspelt_kind_of_source_lists_the_valid_ones():
    assert "no such source; valid: phantom[:SCENARIO]" in refuse("run", "fantom:align_then_approach")


@pytest.mark.parametrize("suffix", [".bag", ".db3", ""])
def test_a_recording_has_the_suffix_of_its_format(quick_uri, tmp_path, suffix):
    file = tmp_path / f"run{suffix}"
    sentence = f"haptigraph: {file}: a recording is MCAP; its name ends in .mcap"
    assert refuse("run", quick_uri, "--fast", "--record", file) == sentence
    assert not file.exists()


@pytest.mark.parametrize("at_s", [-1, 60])
def test_a_moment_outside_a_recording_is_refused_with_the_valid_ones(recording, at_s):
    assert refuse("explain", recording, "--at", at_s) == (
        f"haptigraph: {recording}: has no step at {at_s} s; valid: 0 to 7.73 s"
    )


def test_a_folder_that_is_no_clip_says_what_one_holds(tmp_path):
    (tmp_path / "clip.mp4").write_bytes(b"")
    assert refuse("evaluate", tmp_path) == (
        f"haptigraph: {tmp_path}: registration.toml and truth.csv are missing; a labelled clip is a folder with "
        "clip.mp4, registration.toml and truth.csv"
    )


def test_help_of_replay_does_not_contradict_itself():
    text = " ".join(call("replay", "--help").output.split())
    assert "default: the recorded one" in text and "default: subretinal_injection" not in text


def test_check_lists_kinds_and_what_is_beyond_a_device(procedure, tmp_path):
    assert "guidance" in call("check").output and "assumed" not in call("check").output
    file = tmp_path / "p.toml"
    file.write_text(procedure.text.replace("on_ms = 100", "on_ms = 30"))
    refused = call("check", file, "--device", "gamepad:0")
    assert refused.exit_code == 1
    assert "success: 30 ms on, 100 ms off become 50 on" in refused.output
    assert "gamepad plays one of its own" in call("check", "--device", "gamepad").output
    assert call("check", "--device", "audio").exit_code == 0
    assert "unknown device 'none'; valid: audio, console" in refuse("check", "--device", "none")
    file.write_text(procedure.text.replace("target_hit", "on_target").replace('kind = "success"\n', ""))
    assert "success (assumed)" in call("check", file).output
