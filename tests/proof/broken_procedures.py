"""Break shipped procedures as people do: text -> text, in units, in touch, in time, in what is never seen.

Also sensible variants, which nothing may refuse.
"""

import re
from collections.abc import Callable
from typing import NamedTuple

from haptigraph.assemble import load_procedure

PLAIN, SMOOTH, IOCT = "subretinal_injection", "subretinal_injection_continuous", "subretinal_injection_ioct"
PHASES, STEADY, PEELING = "subretinal_injection_phases", "subretinal_injection_steady", "membrane_peeling"
CAUTIOUS = "subretinal_injection_cautious"
BOUND = re.compile(r"^(at_most|below|at_least|above|release)( = )(-?[\d.]+)", re.MULTILINE)
PAIR = re.compile(r"^(start|end)( = \[)(-?[\d.]+)", re.MULTILINE)

Edit = Callable[[str], str]


class Case(NamedTuple):
    """A procedure with a mistake."""

    name: str
    procedure: str
    edits: tuple[Edit, ...]
    says: str
    """A part of the sentence that refuses it, as a regular expression."""
    device: str = ""
    perceiver: str = ""

    @property
    def text(self) -> str:
        """The file with the mistake."""
        return edited(self.procedure, *self.edits)


def edited(procedure: str, *edits: Edit) -> str:
    """Return the text of a shipped procedure after some edits; each must change it."""
    text = load_procedure(procedure).text
    for edit in edits:
        before, text = text, edit(text)
        assert text != before, (procedure, edit)
    return text


def swap(old: str, new: str, count: int = 1) -> Edit:
    """Replace a text, which must be there."""
    return lambda text: text.replace(old, new, count)


def blocks(text: str) -> list[str]:
    """Split a file before each table of an array."""
    return re.split(r"(?m)^(?=\[\[)", text)


def inside(heading: str, *edits: Edit) -> Edit:
    """Edit only the table of an array that begins like this: "[[pattern]] low"."""
    kind, _, name = heading.partition(" ")

    def edit(text: str) -> str:
        parts = blocks(text)
        for at, part in enumerate(parts):
            if part.startswith(kind) and (
                not name or re.search(rf'^(name|predicate) = "{name}"', part, re.MULTILINE)
            ):
                for one in edits:
                    part = one(part)
                parts[at] = part
                if name:
                    break
        return "".join(parts)

    return edit


def key(name: str, value: str) -> Edit:
    """Give a key of a table another value, or add it."""

    def edit(part: str) -> str:
        line = re.compile(rf"^{name} = [^\n#]*", re.MULTILINE)
        if line.search(part):
            return line.sub(lambda _: f"{name} = {value}", part, count=1)
        return part.replace("\n", f"\n{name} = {value}\n", 1)

    return edit


def without(name: str) -> Edit:
    """Remove a key of a table."""
    return lambda part: re.sub(rf"^{name} = [^\n]*\n", "", part, count=1, flags=re.MULTILINE)


def drop(kind: str, name: str = "") -> Edit:
    """Remove all tables of an array, or one."""

    def edit(text: str) -> str:
        return "".join(
            part
            for part in blocks(text)
            if not (part.startswith(f"[[{kind}]]") and (not name or f'name = "{name}"' in part))
        )

    return edit


def scaled(unit: str, factor: float) -> Edit:
    """Multiply every threshold in a unit, as a slip of units does."""

    def times(found: re.Match[str]) -> str:
        return f"{found[1]}{found[2]}{float(found[3]) * factor:.10g}"

    def edit(text: str) -> str:
        parts = blocks(text)
        for at, part in enumerate(parts):
            if re.search(rf'^measure = "\w+_{unit}"', part, re.MULTILINE):
                parts[at] = PAIR.sub(times, BOUND.sub(times, part))
        return "".join(parts)

    return edit


def then(addition: str) -> Edit:
    """Append tables."""
    return lambda text: f"{text}\n{addition}"


LONE_TEMPORAL = """
[[temporal]]
name = "{name}"
when = [["needle_tip", "touching", "retina_surface"]]
unless = [["needle_tip", "touching", "retina_target"]]
feels = ["{feels}"]
within_ms = {within_ms}
"""
GHOST = """
[[entity]]
name = "retinal_vessel"
group = "anatomy"
geometry = "point"

[[relation]]
subject = "needle_tip"
predicate = "touching"
object = "retinal_vessel"
measure = "distance_mm"
alias = "to_vessel_mm"
at_most = 0.4
"""
BLEEDING = """[[state]]
name = "vessel_contact"
kind = "alarm"
when = [["needle_tip", "touching", "retinal_vessel"]]
feel = "pulse"
because = "the tip touches a vessel"

"""


def before_state(name: str, addition: str) -> Edit:
    """Insert a state before another."""
    return lambda text: text.replace(
        f'[[state]]\nname = "{name}"', f'{addition}[[state]]\nname = "{name}"', 1
    )


UNITS = [
    Case("micrometres read as millimetres", PLAIN, (scaled("mm", 1000),), "at_most = 700 mm separates nothing.*did you mean 700 um, which is 0.7 mm"),
    Case("micrometres read as millimetres, continuous", SMOOTH, (scaled("mm", 1000),), "did you mean 700 um, which is 0.7 mm"),
    Case("micrometres read as millimetres, peeling", PEELING, (scaled("mm", 1000),), "did you mean 400 um, which is 0.4 mm"),
    Case("micrometres read as millimetres, phases", PHASES, (scaled("mm", 1000),), "did you mean 700 um, which is 0.7 mm"),
    Case("metres read as millimetres", PLAIN, (scaled("mm", 0.001),), "too small to be measured.*did you mean 0.0007 m, which is 0.7 mm"),
    Case("metres read as millimetres, peeling", PEELING, (scaled("mm", 0.001),), "did you mean 0.0004 m, which is 0.4 mm"),
    Case("centimetres read as millimetres", PLAIN, (scaled("mm", 10),), "touching is from 0 to at most 3.75 mm"),
    Case("radians read as degrees", PLAIN, (scaled("deg", 0.0174533),), "did you mean 0.0296706 rad, which is 1.7 deg"),
    Case("radians read as degrees, cautious", CAUTIOUS, (scaled("deg", 0.0174533),), "did you mean 0.0296706 rad, which is 1.7 deg"),
    Case("degrees converted twice", PLAIN, (scaled("deg", 57.29578),), "97.4028 deg separates nothing"),
    Case("millimetres read as micrometres", IOCT, (scaled("um", 0.001),), "did you mean 0.5 mm, which is 500 um"),
    Case("nanometres read as micrometres", IOCT, (scaled("um", 1000),), "did you mean 500000 nm, which is 500 um"),
    Case("one threshold in micrometres", PLAIN, (inside("[[relation]] touching", key("at_most", "700")), inside("[[relation]] approaching", key("above", "700"), key("at_most", "5500")), inside("[[gap]]", key("above", "5500"))), "did you mean 700 um, which is 0.7 mm"),
    Case("contact everywhere in the eye", PLAIN, (inside("[[relation]] touching", key("at_most", "40.0")), inside("[[relation]] approaching", key("above", "40.0"), key("at_most", "60.0")), inside("[[gap]]", key("above", "60.0"))), "at_most = 40 mm separates nothing"),
    Case("contact nowhere in the eye", PLAIN, (inside("[[relation]] touching", key("at_most", "-40.0")), inside("[[relation]] approaching", key("above", "-40.0"))), "at_most = -40 mm separates nothing"),
    Case("inside begins beyond the middle of any eye", PLAIN, (inside("[[relation]] inside", key("at_least", "20.0")), inside("[[relation]] outside", key("below", "20.0"))), "at_least = 20 mm separates nothing: wall_mm"),
    Case("outside ends far outside", PLAIN, (inside("[[relation]] inside", key("at_least", "-30.0")), inside("[[relation]] outside", key("below", "-30.0"))), "at_least = -30 mm separates nothing: wall_mm"),
    Case("a target as large as the eye", PLAIN, (lambda text: text.replace('measure = "radial_mm"             # the paper\'s "radial d": the distance from the line trocar -> target\nat_most = 0.7', 'measure = "radial_mm"\nat_most = 24.0'),), "at_most = 24 mm separates nothing: radial_mm"),
    Case("always aligned", PLAIN, (inside("[[relation]] aligned", key("at_most", "180.0")), inside("[[relation]] misaligned", key("above", "180.0"))), "at_most = 180 deg separates nothing"),
    Case("a written unit of another dimension", PLAIN, (inside("[[relation]] aligned", key("at_most", '"1.7 mm"')),), "valid: deg, rad.*found '1.7 mm'"),
    Case("a written unit that is none", PLAIN, (inside("[[relation]] aligned", key("at_most", '"1.7 furlongs"')),), "found '1.7 furlongs'"),
    Case("a release a thousand times too far", IOCT, (inside("[[relation]] too_near", key("release", "85000")),), "release = 85000 um separates nothing"),
    Case("a layer as thick as the eye", IOCT, (inside("[[relation]] at_depth_of", key("at_most", "15000"), key("release", "35000")),), "at_most = 15000 um separates nothing"),
    Case("millimetres written in a measure of micrometres", IOCT, (inside("[[relation]] too_near", key("at_most", "0.075"), key("release", "0.085")),), "did you mean 0.075 mm, which is 75 um"),
]  # fmt: skip

TOUCH = [
    Case("guidance stronger than the alarm", PLAIN, (inside("[[pattern]] pulse", key("amplitude", "0.3")), inside("[[pattern]] low", key("amplitude", "1.0"))), "weaken 'low'"),
    Case("guidance as strong as the alarm", PLAIN, (inside("[[pattern]] low", key("amplitude", "1.0")),), "'pulse' of amplitude 1, .* 'low' of 1; weaken 'low'"),
    Case("guidance hardly weaker than the alarm", PLAIN, (inside("[[pattern]] low", key("amplitude", "0.97")),), "'low' of 0.97; weaken 'low'"),
    Case("success stronger than the alarm", PLAIN, (inside("[[pattern]] pulse", key("amplitude", "0.5")),), "give the alarm 0.8 or more"),
    Case("an alarm identical to guidance", PLAIN, (inside("[[pattern]] low", key("kind", '"pulses"'), key("amplitude", "1.0"), key("frequency_hz", "160"), key("on_ms", "80"), key("off_ms", "80")),), "'pulse' and 'low', which cannot be distinguished"),
    Case("an alarm almost like guidance", PLAIN, (inside("[[pattern]] low", key("kind", '"pulses"'), key("amplitude", "0.95"), key("frequency_hz", "150"), key("on_ms", "85"), key("off_ms", "80")),), "'pulse' and 'low', which cannot be distinguished"),
    Case("guidance that follows up to the alarm", SMOOTH, (lambda text: text.replace("end = [10.0, 0.6]", "end = [10.0, 1.0]"),), "'lean' of 1; weaken 'lean'"),
    Case("guidance whose rate reaches that of the alarm, at its strength", SMOOTH, (lambda text: text.replace("end = [10.0, 0.6]", "end = [10.0, 1.0]").replace("[0.7, 4.0]", "[0.7, 6.25]"),), "'near' of 1; weaken 'near'"),
    Case("an alarm of amplitude 0.001", PLAIN, (inside("[[pattern]] pulse", key("amplitude", "0.001")),), "'pulse' has amplitude 0.001, which is not felt"),
    Case("everything a thousandth as strong", PLAIN, (lambda text: re.sub(r"amplitude = ([\d.]+)", lambda found: f"amplitude = {float(found[1]) / 1000:g}", text),), "'low' has amplitude 0.0003, which is not felt"),
    Case("an alarm with one burst an hour", PLAIN, (inside("[[pattern]] pulse", key("off_ms", "3600000")),), "pauses for 3.6e.06 ms"),
    Case("an alarm with a pause of three seconds", PLAIN, (inside("[[pattern]] pulse", key("off_ms", "3000")),), "pauses for 3000 ms"),
    Case("an alarm once on entry", PLAIN, (inside("[[pattern]] pulse", key("kind", '"bursts"'), key("count", "2")),), "plays once; an alarm repeats"),
    Case("an alarm of 5,000 Hz", PLAIN, (inside("[[pattern]] pulse", key("frequency_hz", "5000")),), "'pulse' vibrates at 5000 Hz, which skin does not feel"),
    Case("an alarm of 2 Hz", PLAIN, (inside("[[pattern]] pulse", key("frequency_hz", "2")),), "'pulse' vibrates at 2 Hz, which skin does not feel"),
    Case("guidance of 5,000 Hz", PLAIN, (inside("[[pattern]] low", key("frequency_hz", "5000")),), "'low' vibrates at 5000 Hz"),
    Case("bursts of 1 ms", PLAIN, (inside("[[pattern]] success", key("on_ms", "1")),), "'success' has bursts of 1 ms, which are not felt"),
    Case("an alarm in pulses of 1 ms", PLAIN, (inside("[[pattern]] pulse", key("on_ms", "1")),), "'pulse' has bursts of 1 ms, which are not felt"),
    Case("a pause too short to be felt", PLAIN, (inside("[[pattern]] success", key("off_ms", "1")),), "'success' has pauses of 1 ms, which are not felt"),
    Case("bursts without end", PLAIN, (inside("[[pattern]] success", key("count", "1000")),), "goes on for 199900 ms"),
    Case("a double burst of a minute", PLAIN, (inside("[[pattern]] success", key("on_ms", "60000")),), "goes on for 120100 ms"),
    Case("follow inverted", SMOOTH, (swap("start = [1.7, 0.15]               # where \"misaligned\" begins: barely perceptible\nend = [10.0, 0.6]", "start = [1.7, 0.6]\nend = [10.0, 0.15]"),), "amplitude of 'lean' falls as theta_deg becomes larger"),
    Case("a rate inverted", SMOOTH, (swap("start = [5.5, 1.5]\nend = [0.7, 4.0] ", "start = [5.5, 4.0]\nend = [0.7, 1.5] "),), "rate_hz of 'near' falls as distance_to_retina_mm becomes smaller"),
    Case("a pull inverted", PEELING, (swap("start = [1.8, 0.1]\nend = [6.0, 0.5]", "start = [1.8, 0.5]\nend = [6.0, 0.1]"),), "amplitude of 'pull' falls as lift_mm becomes larger"),
    Case("a depth inverted", IOCT, (swap("start = [200, 2.0]\nend = [20, 5.0]", "start = [200, 5.0]\nend = [20, 2.0]"),), "rate_hz of 'sink' falls as above_target_um becomes smaller"),
    Case("a dead band of 50 degrees", SMOOTH, (swap("dead_band = 0.1 ", "dead_band = 50 "),), "ignores changes of theta_deg up to 50"),
    Case("follow where the state never is", SMOOTH, (swap("start = [1.7, 0.15]               # where \"misaligned\" begins: barely perceptible\nend = [10.0, 0.6]", "start = [0.1, 0.15]\nend = [1.6, 0.6]"),), "'lean' follows theta_deg from 0.1 to 1.6, but is felt from 1.7"),
    Case("follow in another unit", SMOOTH, (swap("start = [5.5, 1.5]\nend = [0.7, 4.0] ", "start = [5500, 1.5]\nend = [700, 4.0] "),), "near follows distance_to_retina_mm: 5500 mm separates nothing"),
    Case("an alarm that a fixed-frequency device plays like guidance", PLAIN, (inside("[[pattern]] low", key("kind", '"pulses"'), key("amplitude", "0.7"), key("frequency_hz", "60"), key("on_ms", "80"), key("off_ms", "80")),), "'pulse' and 'low', which cannot be distinguished", "serial"),
    Case("a silent alarm", PLAIN, (inside("[[state]] outside_eye", key("kind", '"alarm"')),), "the alarm 'outside_eye' feels 'off', which is silence"),
    Case("an alarm in the colour of success", PLAIN, (inside("[[state]] retinal_contact", key("color", '"#1b7a43"')), inside("[[state]] target_hit", key("color", '"#1b7a43"'))), "retinal_contact.*target_hit|target_hit.*retinal_contact"),
    Case("an alarm in the colour of silence", PLAIN, (inside("[[state]] retinal_contact", key("color", '"#2f6fb3"')), inside("[[state]] aligned_retinal_approach", key("color", '"#2f6fb3"'))), "retinal_contact.*aligned_retinal_approach|aligned_retinal_approach.*retinal_contact"),
    Case("a colour that is none", PLAIN, (inside("[[state]] retinal_contact", key("color", '"rouge"')),), "rouge"),
]  # fmt: skip

TIME = [
    Case("contradictory temporal claims", PLAIN, (then(LONE_TEMPORAL.format(name="contact is silent", feels="off", within_ms=100)),), "wants pulse, 'contact is silent' wants off"),
    Case("a temporal claim against the rules", PLAIN, (then('[[temporal]]\nname = "aligned is felt"\nwhen = [["needle_line", "aligned", "retina_target"], ["needle_tip", "inside", "eye_globe"]]\nunless = [["needle_tip", "touching", "retina_surface"]]\nfeels = ["low"]\nwithin_ms = 100\n'),), "'aligned is felt' wants low; here 'aligned_.*' feels 'off'"),
    Case("a hold longer than a temporal claim allows", PLAIN, (inside("[[state]] misaligned_retinal_approach", key("hold_ms", "500")), then('[[temporal]]\nname = "aligned is silent at once"\nwhen = [["needle_line", "aligned", "retina_target"], ["needle_tip", "approaching", "retina_surface"]]\nfeels = ["off"]\nwithin_ms = 100\n')), "allows 100 ms, but misaligned_retinal_approach.* held for 500 ms"),
    Case("a hold on the target that delays the alarm by 5 s", PHASES, (inside("[[state]] target_hit", key("hold_ms", "5000")),), "target_hit is held for 5000 ms, which delays retinal_contact"),
    Case("a hold on success before the alarm", IOCT, (lambda text: text.replace('feel = "success"\nbecause', 'feel = "success"\nhold_ms = 5000\nbecause', 1), lambda text: move_state(text, "target_depth", "near_rpe")), "target_depth is held for 5000 ms, which delays near_rpe"),
    Case("a hold on an unseen tip", PLAIN, (inside("[[state]] tip_not_visible", key("hold_ms", "3000")),), "tip_not_visible is held for 3000 ms, which delays retinal_contact"),
    Case("a temporal claim whose premise is impossible", PLAIN, (then('[[temporal]]\nname = "both"\nwhen = [["needle_line", "aligned", "retina_target"], ["needle_line", "misaligned", "retina_target"]]\nfeels = ["off"]\nwithin_ms = 100\n'),), "applies to no graph"),
    Case("a dwell on the alarm", PLAIN, (inside("[[state]] retinal_contact", key("enter_after_ms", "500")),), "an alarm never waits"),
]  # fmt: skip


def move_state(text: str, name: str, before: str) -> str:
    """Move a state before another."""
    parts = blocks(text)
    moved = next(part for part in parts if part.startswith("[[state]]") and f'name = "{name}"' in part)
    parts.remove(moved)
    at = next(
        i for i, part in enumerate(parts) if part.startswith("[[state]]") and f'name = "{before}"' in part
    )
    return "".join([*parts[:at], moved, *parts[at:]])


SEEN = [
    Case("a fixed needle", PLAIN, (inside("[[entity]] needle_tip", without("only_with"), key("fixed", "true")), inside("[[entity]] needle_line", key("fixed", "true"))), "needle_tip is an instrument, which may be lost from sight"),
    Case("a fixed tip", PLAIN, (inside("[[entity]] needle_tip", without("only_with"), key("fixed", "true")),), "needle_tip is an instrument, which may be lost from sight"),
    Case("fixed forceps", PEELING, (inside("[[entity]] left_jaw", key("fixed", "true")),), "left_jaw is an instrument, which may be lost from sight"),
    Case("an entity that nobody reports", PLAIN, (swap("[[relation]]\n", GHOST.lstrip() + "\n[[relation]]\n"), before_state("retinal_contact", BLEEDING), drop("invariant")), "vessel_contact cannot occur: perceiver tracker reports no retinal_vessel", perceiver="tracker"),
    Case("forceps for a needle", PEELING, (), "retinal_contact cannot occur: perceiver tracker reports no forceps_jaws", perceiver="tracker"),
    Case("guidance before the alarm", PLAIN, (lambda text: move_state(text, "misaligned_intraocular_navigation", "retinal_contact"),), "'misaligned_intraocular_navigation', which feels 'low'"),
    Case("success away from the target", PLAIN, (lambda text: text.replace("from the line trocar -> target\nat_most", "from the line trocar -> target\nabove"),), "touching needs an upper bound of radial_mm"),
    Case("success once the shaft is aligned", PLAIN, (inside("[[state]] target_hit", key("when", '[["needle_line", "aligned", "retina_target"]]')), drop("invariant")), "target_hit is success far from anything"),
    Case("a burst of success that is hardly felt", PLAIN, (inside("[[pattern]] success", key("amplitude", "0.15")),), "'success' has amplitude 0.15, which may be missed"),
    Case("a release that never comes", IOCT, (inside("[[relation]] at_depth_of", key("release", "2000")),), "release = 2000 um is 1985 um from its bound"),
    Case("inside and outside exchanged", PLAIN, (inside("[[relation]] inside", without("at_least"), key("below", "0.0")), inside("[[relation]] outside", without("below"), key("at_least", "0.0"))), "inside needs a lower bound"),
    Case("contact at 14 mm", PLAIN, (inside("[[relation]] touching", key("at_most", "14.0")), inside("[[relation]] approaching", key("above", "14.0"), key("at_most", "14.9")), inside("[[gap]]", key("above", "14.9"))), "touching is from 0 to at most 3.75 mm"),
    Case("contact only beyond the retina", PLAIN, (inside("[[relation]] touching", key("at_most", "-0.7")), inside("[[relation]] approaching", key("above", "-0.7"))), "touching is from 0 to at most 3.75 mm"),
    Case("a fixed tool by another name", PLAIN, (inside("[[entity]] needle_tip", without("only_with"), key("group", '"tool"'), key("fixed", "true")),), "needle_tip is fixed, but tracker may lose it"),
    Case("success outside the eye", PLAIN, (inside("[[state]] target_hit", key("when", '[["needle_tip", "outside", "eye_globe"]]')), drop("invariant"), drop("temporal")), "'outside_eye', is shadowed"),
    Case("success before the alarm", PLAIN, (lambda text: move_state(text, "target_hit", "retinal_contact"), inside("[[state]] target_hit", key("when", '[["needle_tip", "touching", "retina_surface"]]'))), "'retinal_contact', is shadowed"),
    Case("two states swapped", PLAIN, (lambda text: move_state(text, "misaligned_intraocular_navigation", "misaligned_retinal_approach"),), "'misaligned_intraocular_navigation', which feels 'low'"),
    Case("contact feels nothing", PLAIN, (inside("[[state]] retinal_contact", key("feel", '"off"')),), "'retinal_contact', which feels 'off'"),
    Case("unknown is felt as success", PLAIN, (inside("[[state]] unknown", key("feel", '"success"')),), "must have a pattern of kind 'off'"),
    Case("a tip that is not seen is all well", PLAIN, (drop("state", "tip_not_visible"), drop("invariant")), "no rule fits this graph"),
    Case("overlapping thresholds", PLAIN, (inside("[[relation]] approaching", key("above", "0.5")),), "hold at once"),
    Case("a gap between thresholds", PLAIN, (inside("[[relation]] approaching", key("above", "0.9")),), "neither"),
    Case("a relation that no rule uses", PLAIN, (without("recorded_only"),), "used by no rule"),
]  # fmt: skip

BROKEN = [*UNITS, *TOUCH, *TIME, *SEEN]

SENSIBLE: dict[str, str] = {}


def _sensible() -> dict[str, str]:
    """Return sensible variants by what was changed."""
    near = (
        inside("[[relation]] touching", key("at_most", "0.5")),
        inside("[[relation]] approaching", key("above", "0.5")),
    )
    return {
        "contact from 0.5 mm": edited(PLAIN, *near),
        "contact from 1.2 mm": edited(PLAIN, inside("[[relation]] touching", key("at_most", "1.2")), inside("[[relation]] approaching", key("above", "1.2"))),
        "aligned to 3 degrees": edited(PLAIN, inside("[[relation]] aligned", key("at_most", "3.0")), inside("[[relation]] misaligned", key("above", "3.0"))),
        "aligned to half a degree": edited(PLAIN, inside("[[relation]] aligned", key("at_most", "0.5")), inside("[[relation]] misaligned", key("above", "0.5"))),
        "approach from 8 mm": edited(PLAIN, inside("[[relation]] approaching", key("at_most", "8.0")), inside("[[gap]]", key("above", "8.0")), lambda text: text.replace("at_most = 5.5", "at_most = 8.0")),
        "hysteresis": edited(PLAIN, inside("[[relation]] touching", key("at_most", "0.7\nrelease = 0.8")), then('[[overlap]]\nrelations = [["needle_tip", "touching", "retina_surface"], ["needle_tip", "approaching", "retina_surface"]]\nbecause = "of the release"\n')),
        "a faster alarm": edited(PLAIN, inside("[[pattern]] pulse", key("on_ms", "60"), key("off_ms", "60"))),
        "a lower guidance": edited(PLAIN, inside("[[pattern]] low", key("amplitude", "0.2"), key("frequency_hz", "60"))),
        "three bursts of success": edited(PLAIN, inside("[[pattern]] success", key("count", "3"))),
        "continuous guidance to 0.5": edited(SMOOTH, lambda text: text.replace("end = [10.0, 0.6]", "end = [8.0, 0.5]")),
        "written units": edited(PLAIN, inside("[[relation]] aligned", key("at_most", '"1.7 deg"')), inside("[[relation]] touching", key("at_most", '"700 um"'))),
        "a thin retina": edited(IOCT, inside("[[relation]] too_near", key("at_most", "50"), key("release", "60"))),
        "kinds not said": edited(PLAIN, lambda text: re.sub(r'\nkind = "(alarm|guidance|success|neutral|unseen)"', "", text)),
        "a hold that delays no alarm": edited(PLAIN, inside("[[state]] misaligned_retinal_approach", key("hold_ms", "150"))),
        "an alarm of 250 Hz": edited(PLAIN, inside("[[pattern]] pulse", key("frequency_hz", "250"))),
    }  # fmt: skip


SENSIBLE.update(_sensible())
