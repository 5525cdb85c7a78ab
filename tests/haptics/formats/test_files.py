"""Files: endings, limits of size, and damaged files, which are refused in one sentence or read."""

import json

import pytest
from helpers import PULSE
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.errors import BadInput
from haptigraph.haptics.formats import files
from haptigraph.haptics.formats.envelope import MAX_MS, Envelope, Transient, enveloped
from haptigraph.haptics.formats.files import FORMATS, checked, format_of, read_envelope
from haptigraph.haptics.formats.fitting import fit

VALID = {
    ending: form.write(Envelope(enveloped(PULSE, 320).amplitude, ((0.0, 90.0), (320.0, 160.0))), "p")
    for ending, form in FORMATS.items()
}
CLICKED = {
    ending: json.loads(form.write(Envelope(((0.0, 0.4), (90.0, 0.4)), (), (Transient(20, 1.0, 90),)), "p"))
    for ending, form in FORMATS.items()
    if ending != ".wav"
}
JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=5),
    st.just([]),
    st.just({}),
    st.just([{}]),
)


def is_read_or_refused(ending, content):
    try:
        envelope = checked(FORMATS[ending].read(content, "a.file"), "a.file")
    except BadInput as error:
        assert str(error).startswith("a.file")
        assert "\n" not in str(error)
        return
    assert 0 < envelope.duration_ms <= MAX_MS
    assert 0 <= envelope.peak <= 1
    fit(envelope, "p")


@pytest.mark.parametrize("ending", FORMATS)
@given(st.binary(max_size=200))
def test_noise_is_refused(ending, content):
    is_read_or_refused(ending, content)


@pytest.mark.parametrize("ending", FORMATS)
@given(st.integers(0, 10**6), st.binary(min_size=1, max_size=4))
def test_damaged_files_are_read_or_refused(ending, place, change):
    content = bytearray(VALID[ending])
    at = place % min(len(content), 3000)
    content[at : at + len(change)] = change
    is_read_or_refused(ending, bytes(content))
    is_read_or_refused(ending, VALID[ending][:at])


def places(value, path=()):
    yield path
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in inner:
        yield from places(item, (*path, key))


@pytest.mark.parametrize("ending", CLICKED)
@given(st.data())
def test_wrong_values_are_read_or_refused(ending, data):
    document = json.loads(json.dumps(CLICKED[ending]))
    *outer, key = data.draw(st.sampled_from([path for path in places(document) if path]))
    table = document
    for step in outer:
        table = table[step]
    if data.draw(st.booleans()):
        table[key] = data.draw(JUNK)
    else:
        del table[key]
    is_read_or_refused(ending, json.dumps(document).encode())


def test_an_unknown_ending_is_refused():
    with pytest.raises(BadInput, match=r"unknown format '.mid'.*valid: .ahap, .haptic, .hjif, .wav"):
        format_of("a.mid")
    assert format_of("A.AHAP") is FORMATS[".ahap"]


def test_a_missing_or_large_file_is_refused(tmp_path, monkeypatch):
    with pytest.raises(BadInput, match="No such file"):
        read_envelope(tmp_path / "a.haptic")
    monkeypatch.setattr(
        files, "FORMATS", {".haptic": files.Format("", FORMATS[".haptic"].read, FORMATS[".haptic"].write, 10)}
    )
    (tmp_path / "a.haptic").write_bytes(bytes(11))
    with pytest.raises(BadInput, match="larger than 0 MB"):
        read_envelope(tmp_path / "a.haptic")


@pytest.mark.parametrize(
    ("envelope", "sentence"),
    [
        (Envelope(((0.0, 0.0), (MAX_MS + 1, 0.0))), "lasts 180.001 s; at most 180 s"),
        (Envelope(tuple((float(at), 0.0) for at in range(40_001))), "40001 points"),
        (
            Envelope(((0.0, 0.0), (9.0, 0.0)), (), (Transient(1.0, 1.0),) * 2001),
            "2001 transients; at most 2000",
        ),
    ],
)
def test_limits_are_kept(envelope, sentence):
    with pytest.raises(BadInput) as error:
        checked(envelope, "a.file")
    assert sentence in str(error.value)
