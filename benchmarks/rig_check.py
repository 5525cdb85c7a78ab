"""How surely `rig check` finds sabotaged rigs, and how often it finds something in sound ones.

`python benchmarks/rig_check.py [--seed N] [--sound N] [--sabotaged N] [--clips DIR ...]`. Sound set-ups are
drawn by the simulator, in conditions that do not make a rig unsound, plus labelled clips; ten sabotages are
done to others, each at three severities. A sabotage counts as found if its own finding is reported.
"""

import argparse
from collections import Counter
from functools import partial
from pathlib import Path

import numpy as np
from rig_setups import SABOTAGES, SOUND, Setup, clip_setup, judged, simulated_setup

ROOT = Path(__file__).parents[1]
CLIPS = (ROOT / "tests" / "data" / "renderings", ROOT.parent / "shared" / "clips")
DEGRADED = ("noise", "blur", "glare", "flicker")
SEVERITIES = 3


def main() -> None:
    """Check set-ups, and print the rates."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: python benchmarks/rig_check.py --seed 1 --sound 10 --sabotaged 2",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seed", type=int, default=5601, help="of all set-ups")
    parser.add_argument("--sound", type=int, default=60, help="sound set-ups that are drawn")
    parser.add_argument("--sabotaged", type=int, default=10, help="set-ups that each sabotage is done to")
    parser.add_argument("--degraded", type=int, default=12, help="set-ups in degraded conditions")
    parser.add_argument("--clips", type=Path, nargs="*", default=CLIPS, help="folders of labelled clips")
    given = parser.parse_args()
    _sound(given.seed, given.sound, given.clips)
    _degraded(given.seed, given.degraded)
    _sabotaged(given.seed, given.sabotaged)


def _sound(seed: int, count: int, folders: tuple[Path, ...]) -> None:
    """Print how many sound set-ups have a finding, and which."""
    clips = [clip.parent for folder in folders for clip in sorted(folder.glob("*/registration.toml"))]
    drawn = [
        (f"simulated {number} {SOUND[number % len(SOUND)]}", partial(simulated_setup, number, seed))
        for number in range(count)
    ]
    setups = [*drawn, *((clip.name, partial(clip_setup, clip)) for clip in clips)]
    false, unjudged = 0, Counter[str]()
    for name, make in setups:
        judgement = judged(make())
        unjudged.update(subject.name for subject in judgement.not_judged)
        if judgement.findings:
            false += 1
            for finding in judgement.findings:
                print(f"  {name}: {finding.name}: {finding.sentence}", flush=True)
    print(f"sound set-ups with a finding: {false} of {len(setups)}")
    print(f"  not judged: {dict(unjudged)}", flush=True)


def _degraded(seed: int, count: int) -> None:
    """Print what is found in degraded conditions, some of which a rig should not be used in."""
    for number in range(count):
        nuisance = DEGRADED[number % len(DEGRADED)]
        judgement = judged(simulated_setup(number, seed + 1, nuisance=nuisance))
        names = ", ".join(finding.name for finding in judgement.findings) or "nothing"
        print(f"degraded, {nuisance}: {names}", flush=True)


def _sabotaged(seed: int, count: int) -> None:
    """Print how often each sabotage is found, by severity."""
    found = {name: np.zeros(SEVERITIES, int) for name in SABOTAGES}
    for number in range(count):
        sound = simulated_setup(number, seed + 2)
        for name in SABOTAGES:
            for severity in range(SEVERITIES):
                found[name][severity] += _is_found(sound, name, severity, number)
    print(f"{'sabotage':28}{'slight':>10}{'medium':>10}{'severe':>10}   found of {count} each")
    for name, counts in found.items():
        print(f"{name:28}" + "".join(f"{each:10}" for each in counts), flush=True)


def _is_found(sound: Setup, name: str, severity: int, number: int) -> bool:
    sabotage, expected = SABOTAGES[name]
    setup = sabotage(sound, severity, np.random.default_rng((number, severity)))
    findings = {finding.name for finding in judged(setup).findings}
    if expected not in findings:
        print(
            f"  missed: {name}, severity {severity}, set-up {number}: {sorted(findings) or 'nothing'}",
            flush=True,
        )
    return expected in findings


if __name__ == "__main__":
    main()
