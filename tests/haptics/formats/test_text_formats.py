"""What .haptic, AHAP and HJIF mean: documents written by hand from the public descriptions."""

import json

import pytest

from haptigraph.errors import BadInput
from haptigraph.haptics.formats import ahap, hjif, meta_haptic
from haptigraph.haptics.formats.curve import value_after, value_before
from haptigraph.haptics.formats.envelope import Envelope, Transient, enveloped
from haptigraph.messages import Pattern


def haptic(amplitude, frequency=None, **more):
    envelopes = {"amplitude": amplitude} | ({} if frequency is None else {"frequency": frequency})
    return {"version": {"major": 1}, "signals": {"continuous": {"envelopes": envelopes}}, **more}


def points(*levels, key="amplitude"):
    return [{"time": time_s, key: level} for time_s, level in levels]


def event(time_s, intensity, sharpness=None, duration_s=None, **more):
    parameters = [{"ParameterID": "HapticIntensity", "ParameterValue": intensity}]
    if sharpness is not None:
        parameters.append({"ParameterID": "HapticSharpness", "ParameterValue": sharpness})
    kind = {"EventType": "HapticTransient"}
    if duration_s is not None:
        kind = {"EventType": "HapticContinuous", "EventDuration": duration_s}
    return {"Event": {"Time": time_s, "EventParameters": parameters, **kind, **more}}


def control(name, time_s, *levels):
    listed = [{"Time": at_s, "ParameterValue": level} for at_s, level in levels]
    return {"ParameterCurve": {"ParameterID": name, "Time": time_s, "ParameterCurveControlPoints": listed}}


def wave(*keyframes, position=0, **more):
    frames = [
        {"relative_position": at}
        | ({} if level is None else {"amplitude_modulation": level})
        | ({} if hertz is None else {"frequency_modulation": hertz})
        for at, level, hertz in keyframes
    ]
    return {
        "effect_type": "Basis",
        "position": position,
        "phase": 0.0,
        "base_signal": "Sine",
        "keyframes": frames,
        **more,
    }


def mpeg(*bands, timescale=1000, library=(), **channel):
    listed = [{"band_type": kind, "effects": list(effects)} for kind, *effects in bands]
    channels = [{"id": 0, "gain": 1.0, "bands": listed, **channel}]
    perception = {
        "id": 0,
        "perception_modality": "Vibrotactile",
        "effect_library": list(library),
        "channels": channels,
    }
    return {"version": "2023", "description": "", "timescale": timescale, "perceptions": [perception]}


def read(module, document):
    return module.read(json.dumps(document).encode(), "a.file")


def refused(module, document):
    with pytest.raises(BadInput) as error:
        read(module, document)
    return str(error.value)


def test_haptic_envelopes_and_emphasis():
    clicked = {"time": 0.1, "amplitude": 0.2, "emphasis": {"amplitude": 0.6, "frequency": 1.0}}
    found = read(
        meta_haptic,
        haptic(
            [*points((0, 0.4)), clicked, *points((0.3, 0.0))], points((0, 0.0), (0.3, 1.0), key="frequency")
        ),
    )
    assert found.amplitude == ((0, 0.4), (100, 0.2), (300, 0))
    assert found.transients == (Transient(100, 0.6, 300),)
    assert value_after(found.frequency_hz, 150) == pytest.approx(175)


def test_haptic_is_silent_before_its_first_breakpoint_and_ignores_what_it_does_not_know():
    found = read(
        meta_haptic, haptic(points((0.2, 0.5), (0.4, 0.5)), [], metadata={"tags": None}, new={"field": -1})
    )
    assert (value_after(found.amplitude, 100), value_after(found.amplitude, 200)) == (0, 0.5)
    assert found.frequency_hz == ()


@pytest.mark.parametrize(
    ("document", "sentence"),
    [
        (haptic([]), "no breakpoints; at least one is needed"),
        (haptic(points((0, 0.5))), "ends at 0 s"),
        (
            haptic(points((0, 0.5), (0.1, 1.5))),
            "amplitude[1].amplitude: expected a number from 0 to 1, found 1.5",
        ),
        (haptic(points((0, 0.5), (0.2, 1), (0.1, 1))), "amplitude[2]: time 0.1 s comes after 0.2 s"),
        (haptic(points((0, 0.5), (-1, 1))), "expected a number from 0 to 180, found -1"),
        (haptic(points((0, 0.5), (1e9, 1))), "expected a number from 0 to 180"),
        (haptic([{"time": 0.5}]), "amplitude[0]: key 'amplitude' is missing"),
        (haptic({"time": 0.5}), "expected a list, found {'time': 0.5}"),
        (
            {**haptic(points((0, 1), (1, 1))), "version": {"major": 2}},
            "version 2 of the format; version 1 can be read",
        ),
        ({**haptic(points((0, 1), (1, 1))), "version": 1}, "version: expected a table, found 1"),
        ([], "expected a table, found []"),
    ],
)
def test_invalid_haptic_is_refused(document, sentence):
    assert sentence in refused(meta_haptic, document)


def test_haptic_is_written_without_two_breakpoints_at_one_time():
    written = json.loads(meta_haptic.write(enveloped(Pattern("p", "pulses", 1, 160, 80, 80), 480), "p"))
    envelopes = written["signals"]["continuous"]["envelopes"]
    times_s = [point["time"] for point in envelopes["amplitude"]]
    assert len(set(times_s)) == len(times_s)
    assert times_s == sorted(times_s)
    assert written["version"] == {"major": 1, "minor": 0, "patch": 0}
    assert (
        "frequency"
        not in json.loads(meta_haptic.write(enveloped(Pattern("p", "continuous", 1), 480), "p"))["signals"][
            "continuous"
        ]["envelopes"]
    )


def test_ahap_events_are_modulated_by_curves():
    curve = control("HapticIntensityControl", 0.1, (0.0, 1.0), (0.1, 0.0))
    sharper = control("HapticSharpnessControl", 0.0, (0.0, 0.2))
    found = read(ahap, {"Pattern": [event(0.0, 0.8, 0.4, 0.2), event(0.15, 1.0, 0.4), curve, sharper]})
    assert value_before(found.amplitude, 100) == pytest.approx(0.8)
    assert value_after(found.amplitude, 150) == pytest.approx(0.4)
    assert found.transients == (Transient(150, pytest.approx(0.5), pytest.approx(200)),)
    assert value_after(found.frequency_hz, 50) == pytest.approx(200)
    assert found.duration_ms == 200


def test_ahap_parameters_count_from_their_time_and_curves_hold_their_last_value():
    louder = {"Parameter": {"ParameterID": "HapticIntensityControl", "Time": 0.1, "ParameterValue": 0.5}}
    found = read(ahap, {"Pattern": [louder, event(0.0, 1.0, None, 0.3)]})
    assert [value_after(found.amplitude, at_ms) for at_ms in (0, 99, 100, 299)] == [1, 1, 0.5, 0.5]
    assert found.frequency_hz == ()  # no sharpness: the device's choice


def test_ahap_of_overlapping_events_is_the_strongest():
    found = read(ahap, {"Pattern": [event(0.0, 0.3, 0.0, 0.3), event(0.1, 0.9, 1.0, 0.1)]})
    assert [value_after(found.amplitude, at_ms) for at_ms in (50, 150, 250)] == [0.3, 0.9, 0.3]
    assert [value_after(found.frequency_hz, at_ms) for at_ms in (50, 150, 250)] == [50, 300, 50]


def test_ahap_says_what_is_not_read():
    custom = {"Event": {"Time": 0, "EventType": "AudioCustom", "EventWaveformPath": "a.wav"}}
    loud = event(0.0, 1.3, 0.5, 0.1)
    loud["Event"]["EventParameters"].append({"ParameterID": "AttackTime", "ParameterValue": 0.1})
    plain = {"Event": {"Time": 0.2, "EventType": "HapticTransient"}}
    found = read(ahap, {"Pattern": [custom, loud, plain]})
    assert found.peak == 1.0
    assert found.notes == (
        "sound left out",
        "intensity or sharpness outside 0 to 1 is limited to it",
        "'AttackTime' left out",
        "an event without intensity is read as 0.5",
    )


@pytest.mark.parametrize(
    ("pattern", "sentence"),
    [
        ([], "no haptic event"),
        (
            [{"ParameterCurves": {}}],
            "Pattern[0]: expected one of Event, Parameter, ParameterCurve, found 'ParameterCurves'",
        ),
        ([{"Event": {"Time": 0, "EventType": "HapticBuzz"}}], "unknown event 'HapticBuzz'"),
        ([{"Event": {"Time": 0, "EventType": "HapticContinuous"}}], "key 'EventDuration' is missing"),
        ([event("0", 1.0)], "Pattern[0].Event.Time: expected a number from 0 to 180, found '0'"),
        ([event(0, None)], "ParameterValue: expected a number"),
        ([event(0, 1.0, None, 0.1)] * 2001, "2001 continuous events; at most 2000"),
        (
            [event(0, 1.0), control("HapticIntensityControl", 0, (0.2, 1), (0.1, 1))],
            "times must not decrease",
        ),
    ],
)
def test_invalid_ahap_is_refused(pattern, sentence):
    assert sentence in refused(ahap, {"Pattern": pattern})


def test_ahap_curves_have_at_most_16_points():
    zigzag = tuple((10.0 * at, at % 2 / 2 + 0.25) for at in range(50))
    written = json.loads(ahap.write(Envelope(zigzag), "z"))["Pattern"]
    curves = [
        entry["ParameterCurve"]["ParameterCurveControlPoints"]
        for entry in written
        if "ParameterCurve" in entry
    ]
    assert len(curves) > 3
    assert max(map(len, curves)) == 16


def test_ahap_beside_a_curve_has_bursts_instead_of_transients():
    both = Envelope(((0.0, 1.0), (100.0, 0.0)), (), (Transient(50, 1.0),))
    assert "HapticTransient" not in ahap.write(both, "p").decode()
    steady = Envelope(((0.0, 0.5), (100.0, 0.5)), (), (Transient(50, 1.0),))
    assert "HapticTransient" in ahap.write(steady, "p").decode()


def test_hjif_waves_references_and_transients():
    shared = wave((0, 0.5, 100), (20, None, None), (40, 1.0, 200), id=7)
    waves = ("VectorialWave", {"effect_type": "Reference", "id": 7, "position": 100})
    clicks = ("Transient", wave((0, 0.4, 90), (60, -0.6, None), position=200))
    found = read(hjif, mpeg(waves, clicks, timescale=2000, library=[shared]))
    assert value_after(found.amplitude, 60) == pytest.approx(0.75)
    assert value_after(found.frequency_hz, 60) == pytest.approx(150)
    assert (value_before(found.amplitude, 50), value_after(found.amplitude, 71)) == (0, 0)
    assert found.transients == (Transient(100, 0.4, 90), Transient(130, 0.6, 0))


def test_hjif_says_what_is_not_read():
    square = wave((0, 0.5, 100), (40, 0.5, 100), base_signal="Square")
    found = read(
        hjif,
        mpeg(
            ("VectorialWave", square, {"effect_type": "Composite", "position": 0}),
            ("Curve", wave()),
            gain=4.0,
        ),
    )
    assert found.notes == (
        "a 'Square' wave is read as a sine",
        "a composed effect left out",
        "a band of type 'Curve' left out",
    )
    assert found.peak == 1.0


@pytest.mark.parametrize(
    ("document", "sentence"),
    [
        (
            mpeg(("Curve", wave((0, 0.5, 100), (40, 0.5, 100)))),
            "no VectorialWave and no Transient, which can be read (a band",
        ),
        (
            mpeg(("VectorialWave", {"effect_type": "Reference", "id": 3, "position": 0})),
            "no effect 3 in effect_library",
        ),
        (
            mpeg(("VectorialWave", {"effect_type": "Reference", "id": [], "position": 0})),
            "no effect [] in effect_library",
        ),
        (mpeg(("VectorialWave", wave((0, 2.0, 100)))), "expected a number from -1 to 1, found 2.0"),
        (mpeg(("VectorialWave", wave((10, 1, 1), (0, 1, 1)))), "times must not decrease"),
        (mpeg(("VectorialWave", wave((10, 1, 1))), timescale=0), "timescale: expected a number from 1 to"),
        ({"perceptions": [{"perception_modality": "Force"}]}, "no perception of modality 'Vibrotactile'"),
        ({"version": "2023"}, "key 'perceptions' is missing"),
    ],
)
def test_invalid_hjif_is_refused(document, sentence):
    assert sentence in refused(hjif, document)


def test_hjif_has_the_keys_that_the_reference_software_requires():
    written = json.loads(hjif.write(enveloped(Pattern("p", "bursts", 1, 160, 80, 80, 2), 0), "p"))
    assert {
        "version",
        "profile",
        "level",
        "date",
        "description",
        "timescale",
        "avatars",
        "perceptions",
        "syncs",
    } <= written.keys()
    (perception,) = written["perceptions"]
    assert {
        "id",
        "avatar_id",
        "description",
        "perception_modality",
        "channels",
        "effect_library",
    } <= perception.keys()
    (channel,) = perception["channels"]
    assert {"id", "description", "gain", "mixing_coefficient", "body_part_mask", "bands"} <= channel.keys()
    (band,) = channel["bands"]
    assert {"band_type", "lower_frequency_limit", "upper_frequency_limit", "effects"} <= band.keys()
    first, second = band["effects"]
    assert (first["position"], second["position"]) == (0, 160)
    assert first["keyframes"][-1] == {
        "relative_position": 80,
        "amplitude_modulation": 1,
        "frequency_modulation": 160,
    }


@pytest.mark.parametrize("module", [meta_haptic, ahap, hjif])
@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "a.file, line 1: not JSON"),
        (b"{\n'", "a.file, line 2: not JSON"),
        (b"\xff\xfe", "not UTF-8 text (byte 0)"),
        (b"[" * 100_000, "nested too deeply"),
        (b"1" * 10_000, "a number too long"),
    ],
)
def test_what_is_not_json_is_refused(module, content, sentence):
    with pytest.raises(BadInput, match=r"a\.file") as error:
        module.read(content, "a.file")
    assert sentence in str(error.value)


def test_names_in_a_file_cannot_control_the_terminal():
    odd = event(0.0, 0.5, None, 0.1)
    odd["Event"]["EventParameters"].append({"ParameterID": "\x1b[2J\n", "ParameterValue": 0.1})
    assert read(ahap, {"Pattern": [odd]}).notes == (r"'\x1b[2J\n' left out",)
    assert r"'\x1b[2J\n'" in refused(ahap, {"Pattern": [{"\x1b[2J\n": 1}]})
