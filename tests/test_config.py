import pytest
from paths import DATA

from haptigraph.config import Config, load_config
from haptigraph.errors import BadInput
from haptigraph.toml_document import Document


def error_of(*settings: str) -> str:
    with pytest.raises(BadInput) as raised:
        load_config(None, settings)
    return str(raised.value)


def test_defaults_need_no_file():
    assert load_config() == Config()


def test_settings_override_a_file(tmp_path):
    file = tmp_path / "lab.toml"
    file.write_text("[perception]\nalpha = 0.2\noffset_grey = 12\n")
    config = load_config(file, ("perception.alpha=1", "source.uri=camera:0", 'run.procedure="a.toml"'))
    assert config.perception.alpha == 1.0
    assert config.perception.offset_grey == 12.0
    assert config.source.uri == "camera:0"
    assert config.run.procedure == "a.toml"


def test_a_settings_file_of_version_0_1_is_read():
    config = load_config(DATA / "v0_1" / "settings.toml")
    assert (config.source.jpeg_quality, config.perception.alpha, config.haptics.deadman_ms) == (
        80,
        1.0,
        120.0,
    )


def test_an_unknown_key_names_the_valid_ones():
    message = error_of("perception.alpa=1")
    assert "unknown key 'alpa'; did you mean 'alpha'?" in message
    assert "block_size_px" in message
    assert "unknown key 'perceptio'" in error_of("perceptio.alpha=1")


@pytest.mark.parametrize(
    ("setting", "problem"),
    [
        ("perception.alpha=2", "perception.alpha: expected float <= 1.0, found 2"),
        ("perception.alpha=fast", "perception.alpha: expected float, got str, found 'fast'"),
        ("perception.block_size_px=50", "block_size_px must be odd, found 50"),
        ("perception.polarity=red", "unknown polarity 'red'; valid: auto, bright, dark"),
        ("perception=3", "expected table"),
        ("perception.alpha.x=1", "perception.alpha: expected float, got table"),
        ("perception.alpha", "expected KEY=VALUE"),
        ("perception.alpha=nan", "perception.alpha: expected a finite number, found nan"),
        ("haptics.max_on_ms=inf", "haptics.max_on_ms: expected a finite number, found inf"),
        ("haptics.max_on_ms=1e300", "haptics.max_on_ms: expected float <= 86400000.0, found 1e+300"),
        ("haptics.rest_ms=0.1", "haptics.rest_ms: expected float >= 1.0, found 0.1"),
        ("run.stale_ms=1e9", "run.stale_ms: expected float <= 60000.0, found 1000000000.0"),
        ("source.rate_hz=1e-300", "source.rate_hz: expected float >= 0.01, found 1e-300"),
        ("perception.offset_grey=1e9", "perception.offset_grey: expected float <= 255.0"),
        (f"haptics.deadman_ms=1{'0' * 400}", "haptics.deadman_ms: "),
        (f"perception.alpha={'[' * 9000}", "perception.alpha: expected float, got str"),
        ("run.realtime=yes", "run.realtime: expected bool"),
    ],
)
def test_an_invalid_setting_is_reported_with_what_is_valid(setting, problem):
    assert problem in error_of(setting)


def test_a_setting_below_a_value_is_rejected(tmp_path):
    file = tmp_path / "lab.toml"
    file.write_text("[perception]\nalpha = 0.2\n")
    with pytest.raises(BadInput, match="'alpha' is a value, not a table"):
        load_config(file, ("perception.alpha.x=1",))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[haptics]\ndeadman = 3\n", "line 2: unknown key 'deadman'; did you mean 'deadman_ms'?"),
        ("[perception]\n\nalpha = 'x'\n", "line 3: perception.alpha: expected float, got str, found 'x'"),
        ("[perception]\nalpha = nan\n", "line 2: perception.alpha: expected a finite number, found nan"),
        (f"[perception]\nalpha = {'[' * 9000}\n", "nested too deeply"),
        ("[perception\n", "line 1, column 12: not valid TOML"),
        ("[run]\nstale_ms = = 1\n", "line 2, column 12: not valid TOML: invalid value"),
    ],
)
def test_an_error_in_a_file_is_reported_with_its_line(tmp_path, text, problem):
    file = tmp_path / "lab.toml"
    file.write_text(text)
    with pytest.raises(BadInput) as raised:
        load_config(file)
    message = str(raised.value)
    assert message.startswith(f"{file}, {problem}" if problem.startswith("line") else f"{file}: ")
    assert problem in message


def test_a_byte_order_mark_is_accepted(tmp_path):
    file = tmp_path / "lab.toml"
    file.write_bytes(b"\xef\xbb\xbf[perception]\nalpha = 0.25\n")
    assert load_config(file).perception.alpha == 0.25


def test_numbers_that_are_not_finite_are_found_in_lists_of_tables():
    document = Document("[[move]]\nduration_s = 1\n\n[[move]]\npath = [1.0, [-inf]]\n", "s.toml")
    with pytest.raises(BadInput) as raised:
        document.convert(dict)
    assert str(raised.value) == "s.toml, line 5: move[1].path[1][0]: expected a finite number, found -inf"


def test_an_unreadable_file_is_an_error(tmp_path):
    with pytest.raises(BadInput, match=r"gone\.toml: cannot be read \(No such file or directory\)"):
        load_config(tmp_path / "gone.toml")
    latin = tmp_path / "latin.toml"
    latin.write_bytes(b"# \xe9\n")
    with pytest.raises(BadInput, match=r"not UTF-8 text \(byte 2\)"):
        load_config(latin)


def test_lines_are_found_in_repeated_tables():
    document = Document('top = 1\n[[state]]\nname = "a"\n\n[[state]]\nname = "b"\nfeel = "x"\n', "p.toml")
    assert "line 7" in str(document.error("wrong", "state[1].feel"))
    assert "line 2" in str(document.error("wrong", "state[0].feel"))
    assert "line 1" in str(document.error("wrong", "top"))
    assert str(document.error("wrong", "nowhere")) == "p.toml: wrong"
