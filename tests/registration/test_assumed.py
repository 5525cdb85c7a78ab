"""What a registration assumes and nobody measured: in the file, and in sentences."""

import pytest
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.registration.assumed import assumed_notes, assumed_text, needs_consent
from haptigraph.registration.camera import anatomy_px
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.retarget import with_target
from haptigraph.registration.text import registration_text, scan_registration_text


@pytest.fixture(scope="module")
def assuming(registration):
    anatomy = replace(anatomy_px(registration), assumed=("target", "scale"))
    return registration_text(anatomy, "An eye.")


def test_a_file_without_the_key_assumes_nothing(registration, registration_toml):
    assert "assumed" not in registration_toml
    assert registration.assumed == ()
    assert assumed_notes((), "click it", is_accepted=False) == []


def test_what_is_assumed_survives_writing_and_reading(assuming):
    read = parse_registration(assuming, "eye.toml")
    assert read.assumed == ("target", "scale")
    assert registration_text(anatomy_px(read), "An eye.") == assuming


def test_b_scans_have_the_key_too():
    text = scan_registration_text((400, 300), 0.0033, 0.0078, "A scanner.", assumed=("target",))
    assert parse_registration(text, "scan.toml").assumed == ("target",)


def test_the_default_depth_of_b_scans_is_assumed():
    text = scan_registration_text((400, 300), 0.0033, 0.0078, "A scanner.")
    assert parse_registration(text, "scan.toml").assumed == ()
    assert parse_registration(text.partition("[target]")[0], "scan.toml").assumed == ("target",)


def test_an_unknown_name_is_refused_with_the_valid_ones(assuming):
    with pytest.raises(BadInput, match=r"eye\.toml, line 3: assumed: unknown name 'taget'; valid: globe, "):
        parse_registration(assuming.replace('"target"', '"taget"'), "eye.toml")


def test_a_target_that_a_setting_states_is_not_assumed(assuming):
    assert with_target(parse_registration(assuming, "eye.toml"), 2.0).assumed == ("scale",)


@pytest.mark.parametrize(
    ("assumed", "needed", "text"),
    [
        ((), False, ""),
        (("scale",), False, "the scale"),
        (("target",), True, "the target"),
        (("trocar", "target", "scale"), True, "the trocar, the target and the scale"),
    ],
)
def test_positions_need_consent(assumed, needed, text):
    assert needs_consent(assumed) is needed
    assert assumed_text(assumed) == text


@pytest.mark.parametrize("accepted", [False, True])
def test_the_note_says_whether_anything_vibrates(accepted):
    (note,) = assumed_notes(("target",), "click it", is_accepted=accepted)
    assert note.startswith("haptigraph: assumed, not measured: the target; ")
    assert ("haptic output is on" in note, "haptic output is off: click it" in note) == (
        accepted,
        not accepted,
    )
