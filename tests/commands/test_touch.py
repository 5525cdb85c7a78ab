"""haptigraph touch: convert, draw, play, formats."""

import csv
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from helpers import call, refuse

from haptigraph.analysis.touch.loading import load_touch
from haptigraph.haptics.formats.envelope import Envelope, Transient
from haptigraph.haptics.formats.files import FORMATS

PULSE = "subretinal_injection:pulse"
FADE = Envelope(((0.0, 1.0), (300.0, 0.0)), ((0.0, 200.0), (300.0, 60.0)), (Transient(100, 0.9, 250),))


@pytest.fixture
def fade(tmp_path) -> Path:
    path = tmp_path / "a fade.haptic"
    path.write_bytes(FORMATS[".haptic"].write(FADE, "fade"))
    return path


@pytest.mark.parametrize("ending", FORMATS)
def test_a_pattern_goes_to_a_file_and_comes_back(tmp_path, ending):
    there = call("touch", "convert", PULSE, "-o", tmp_path / f"alarm{ending}")
    assert "pulses of amplitude 1 at 160 Hz" in there.stdout
    assert "round trip: amplitude 0" in there.stdout
    assert ("not checked against a reference reader" in there.stderr) == (ending == ".hjif")
    call("touch", "convert", tmp_path / f"alarm{ending}", "-o", tmp_path / "back.toml")
    back = load_touch(str(tmp_path / "back.toml"), 2000).pattern
    assert (back.name, back.kind, back.amplitude, back.frequency_hz) == ("back", "pulses", 1.0, 160.0)
    assert (back.on_ms, back.off_ms) == (pytest.approx(80, abs=2), pytest.approx(80, abs=2))


def test_a_pattern_that_comes_back_can_be_pasted_into_a_procedure(tmp_path, procedure):
    call("touch", "convert", "subretinal_injection:success", "-o", tmp_path / "s.ahap")
    call("touch", "convert", tmp_path / "s.ahap", "-o", tmp_path / "twice.toml")
    whole = procedure.text + "\n" + (tmp_path / "twice.toml").read_text()
    (tmp_path / "whole.toml").write_text(whole)
    assert load_touch(f"{tmp_path / 'whole.toml'}:twice", 2000).pattern.count == 2


def test_how_long_a_pattern_lasts_in_a_file_can_be_chosen(tmp_path):
    call("touch", "convert", "subretinal_injection:low", "-o", tmp_path / "low.haptic", "--seconds", "0.5")
    found = load_touch(str(tmp_path / "low.haptic"), 2000)
    assert found.envelope.duration_ms == 500
    assert found.pattern.kind == "continuous"


def test_numbers_that_follow_a_measure_are_named(tmp_path):
    result = call("touch", "convert", "membrane_peeling:pull", "-o", tmp_path / "pull.ahap")
    assert "amplitude follows lift_mm, here at its plain value" in result.stderr


def test_what_no_pattern_plays_is_refused_or_approximated(tmp_path, fade):
    sentence = refuse("touch", "convert", fade, "-o", tmp_path / "fade.toml")
    assert "no pattern has its" in sentence
    assert "--approximate" in sentence
    assert not (tmp_path / "fade.toml").exists()
    result = call("touch", "convert", fade, "-o", tmp_path / "fade.toml", "--approximate")
    assert "round trip: amplitude" in result.stdout
    assert load_touch(str(tmp_path / "fade.toml"), 2000).pattern.kind == "bursts"


def test_a_free_envelope_goes_from_format_to_format(tmp_path, fade):
    result = call("touch", "convert", fade, "-o", tmp_path / "fade.hjif")
    assert "no single pattern" in result.stdout
    assert load_touch(str(tmp_path / "fade.hjif"), 2000).envelope.transients[0].amplitude == 0.9


@pytest.mark.parametrize("name", ["out.ahap", "out.toml", "out.png"])
def test_no_file_is_overwritten(tmp_path, name):
    (tmp_path / name).write_text("mine")
    command = "draw" if name.endswith(".png") else "convert"
    assert "exists already" in refuse("touch", command, PULSE, "-o", tmp_path / name)
    assert (tmp_path / name).read_text() == "mine"


@pytest.mark.parametrize(
    ("source", "output", "sentence"),
    [
        ("subretinal_injection:pulse", "out.midi", "unknown format '.midi'"),
        ("subretinal_injection:puls", "out.ahap", "unknown pattern 'puls'; did you mean 'pulse'?"),
        ("subretinal_injection", "out.ahap", "is no vibration; valid: PROCEDURE:PATTERN"),
        ("nothing.toml", "out.ahap", "cannot be read (No such file or directory)"),
        ("nothing.wav", "out.ahap", "cannot be read (No such file or directory)"),
    ],
)
def test_bad_arguments_are_refused(tmp_path, monkeypatch, source, output, sentence):
    monkeypatch.chdir(tmp_path)
    assert sentence in refuse("touch", "convert", source, "-o", output)
    assert not list(tmp_path.iterdir())


def test_a_pattern_file_is_checked(tmp_path):
    path = tmp_path / "p.toml"
    path.write_text('[[pattern]]\nname = "p"\nkind = "pulses"\namplitude = 1.0\non_ms = 80\n')
    assert "p.toml, line 1: pulses needs off_ms of at least 1, found 0" in refuse(
        "touch", "draw", path, "-o", "x.svg"
    )
    path.write_text('[[pattern]]\nname = "p"\nkind = "buzz"\n')
    assert "line 3: unknown kind 'buzz'" in refuse("touch", "draw", path, "-o", "x.svg")
    two = "".join(f'[[pattern]]\nname = "{name}"\nkind = "off"\n' for name in "ab")
    path.write_text(two)
    assert "2 patterns; name one" in refuse("touch", "draw", path, "-o", "x.svg")
    assert load_touch(f"{path}:b", 100).name == "b"


def test_a_pattern_beyond_a_procedures_limits_is_refused_before_it_is_written(tmp_path):
    many = [
        (at, level)
        for n in range(1100)
        for at, level in ((4.0 * n, 1.0), (4.0 * n + 2, 1.0), (4.0 * n + 2, 0.0), (4.0 * n + 4, 0.0))
    ]
    (tmp_path / "many.ahap").write_bytes(FORMATS[".ahap"].write(Envelope(tuple(many[:-1])), "many"))
    assert "count must be at most 1000" in refuse(
        "touch", "convert", tmp_path / "many.ahap", "-o", tmp_path / "m.toml"
    )
    assert not (tmp_path / "m.toml").exists()


@pytest.mark.parametrize("ending", ["svg", "png"])
def test_a_picture_shows_amplitude_and_frequency(tmp_path, fade, ending):
    call("touch", "draw", fade, "-o", tmp_path / f"p.{ending}")
    call("touch", "draw", PULSE, "-o", tmp_path / f"q.{ending}")
    content = (tmp_path / f"p.{ending}").read_bytes()
    assert len(content) > 5000
    if ending == "svg":
        ET.fromstring(content)


def test_a_file_is_played_through_the_guard(tmp_path, fade):
    trace = tmp_path / "t.csv"
    result = call("touch", "play", fade, "--device", f"trace:{trace}", "--max-amplitude", "0.5")
    assert "Research software" in result.stdout
    assert "a_fade  amplitude up to 1, for 0.3 s" in result.stdout
    with trace.open() as file:
        amplitudes = [float(row["amplitude"]) for row in csv.DictReader(file)]
    assert max(amplitudes) == 0.5
    assert amplitudes[-1] == 0


def test_nothing_is_played_without_a_device(fade):
    result = call("touch", "play", fade)
    assert result.exit_code == 2
    assert "Missing option '--device'" in result.stderr


def test_playing_says_what_the_device_cannot_do(tmp_path):
    result = call("touch", "play", "subretinal_injection:success", "--device", f"audio:{tmp_path / 's.wav'}")
    assert "bursts of amplitude 0.8 at 160 Hz, 100 ms on, 100 ms off, 2 times, for 0.3 s" in result.stdout
    assert (tmp_path / "s.wav").stat().st_size > 20_000


def test_formats_report_their_round_trips():
    listed = call("touch", "formats", "--seconds", "1").stdout
    for ending in FORMATS:
        assert ending in listed
    assert listed.count("of the same kind; largest error: amplitude 0") == len(FORMATS)
    assert listed.count("not checked against a reference reader") == 1
