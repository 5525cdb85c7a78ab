"""Compare the rank tests, estimates and hit rates of a study report with R: `make compare-r`.

Random data sets, 60 of each kind: without ties, with ties, and with many zeros. Needs R with coin and
exactRankTests (Debian: apt-get install r-base-core r-cran-coin r-cran-exactranktests); installs nothing.
"""

import argparse
import shutil
import subprocess
import sys
from collections.abc import Iterator
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
from msgspec import Struct

from haptigraph.analysis.study.statistics.comparison import omnibus
from haptigraph.analysis.study.statistics.equivalence import equivalence
from haptigraph.analysis.study.statistics.hit_rate import paired_hits, unpaired_hits
from haptigraph.analysis.study.statistics.rank_tests import rank_sum, signed_rank
from haptigraph.analysis.study.statistics.shift import paired_shift, unpaired_shift

SETS = 60
TOLERANCE = 1e-9
ODDS = ("odds", "odds_low", "odds_high")
ODDS_TOLERANCE = 2e-4  # of odds / (1 + odds); R solves for them to 1.2e-4 (uniroot)
LOST_SUM = "exactRankTests loses a sum as far from the mean as the found one by rounding; coin has it"
NAMED = dict.fromkeys((("unpaired tied", "wilcox.exact"), ("unpaired zeros", "wilcox.exact")), LOST_SUM)
PER_KIND = ("plain", "tied", "zeros")


class DataSet(Struct):
    """Samples of one kind."""

    kind: str
    samples: list[np.ndarray]


def data_sets(seed: int) -> Iterator[DataSet]:
    """Yield the data sets; integers make ties, a narrow range of them zeros."""
    rng = np.random.default_rng(seed)
    widths = {"plain": None, "tied": 9, "zeros": 2}
    for design in ("paired", "unpaired"):
        for kind in PER_KIND:
            for _ in range(SETS):
                sizes = [int(rng.integers(4, 17))] * 2
                if design == "unpaired":
                    sizes[1] = int(rng.integers(4, 17))
                yield DataSet(f"{design} {kind}", _drawn(rng, sizes, widths[kind]))
    for _ in range(SETS):
        yield DataSet("omnibus", _drawn(rng, [int(rng.integers(4, 17))] * 3, 6))
        chances = rng.uniform(0.3, 1, 2)
        n = int(rng.integers(4, 25))
        yield DataSet("hits", [(rng.random(n) < chance).astype(float) for chance in chances])


def _drawn(rng: np.random.Generator, sizes: list[int], width: int | None) -> list[np.ndarray]:
    while True:
        offsets = rng.uniform(0, 1.5, len(sizes))
        if width is None:
            samples = [rng.normal(offset, 1.5, n) for offset, n in zip(offsets, sizes, strict=True)]
        else:
            samples = [
                np.rint(rng.uniform(0, width, n) + offset) for offset, n in zip(offsets, sizes, strict=True)
            ]
        if not np.array_equal(samples[0], samples[1]) and np.ptp(np.concatenate(samples)) > 0:
            return samples


def ours(data: DataSet) -> dict[str, float]:
    """Return what this package finds, by the name of R's function."""
    first, second = data.samples[:2]
    if data.kind == "omnibus":
        return {
            "kruskal.test": omnibus(data.samples, paired=False)[2],
            "friedman.test": omnibus(data.samples, paired=True)[2],
        }
    if data.kind == "hits":
        pairs = ([bool(each) for each in sample] for sample in (first, second))
        hits = [*pairs]
        fisher = unpaired_hits(*hits)
        odds = {"odds": fisher.odds_ratio, "odds_low": fisher.low, "odds_high": fisher.high}
        return {"binom.test": paired_hits(*hits).p, "fisher.test": fisher.p, **odds}
    paired = data.kind.startswith("paired")
    test, shift = (signed_rank, paired_shift) if paired else (rank_sum, unpaired_shift)
    found = {
        "wilcox.test exact": test(first, second).p,
        "wilcox.test corrected": test(first, second, exact=False).p,
        "wilcox.test uncorrected": test(first, second, exact=False, continuity=False).p,
    }
    if paired:
        found["wilcox.exact"] = found["wilcoxsign_test Wilcoxon"] = found["wilcox.test exact"]
        found["wilcoxsign_test Pratt"] = signed_rank(first, second, zeros="pratt").p
    else:
        found["wilcox.exact"] = found["wilcox_test"] = rank_sum(first, second, sides="summed").p
    alike, between = equivalence(first, second, -1, 2, paired=paired), shift(first, second)
    return {
        **found,
        "TOST rank": alike.p,
        "TOST t": alike.p_t,
        "shift": between.estimate,
        "shift_low": between.low,
        "shift_high": between.high,
    }


def in_r(sets: list[DataSet]) -> pd.DataFrame:
    """Return what R finds: set, name, value."""
    rows = [
        (number, data.kind, group, repr(float(value)))
        for number, data in enumerate(sets)
        for group, sample in enumerate(data.samples)
        for value in sample
    ]
    text = pd.DataFrame(rows, columns=["set", "kind", "group", "value"]).to_csv(index=False)
    script = Path(__file__).with_suffix(".R")
    done = subprocess.run(["Rscript", script], input=text, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"R failed; are coin and exactRankTests installed?\n{done.stderr}")
    return pd.read_csv(StringIO(done.stdout), names=["set", "name", "value"])


def main() -> None:
    """Print the largest difference of each test and kind; exit with 1 if one is above its tolerance."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if shutil.which("Rscript") is None:
        sys.exit(
            "Rscript is not on PATH; Debian: apt-get install r-base-core r-cran-coin r-cran-exactranktests"
        )
    sets = list(data_sets(given.seed))
    found = [ours(data) for data in sets]
    compared = in_r(sets)
    compared["kind"] = [sets[number].kind for number in compared["set"]]
    compared["ours"] = [
        found[number][name] for number, name in zip(compared["set"], compared["name"], strict=True)
    ]
    is_odds = compared["name"].isin(ODDS)
    for column in ("ours", "value"):
        shares = compared[column] / (1 + compared[column].replace(np.inf, 1e300))
        compared[column] = compared[column].mask(is_odds, shares.fillna(1.0))
    same = compared["ours"] == compared["value"]
    compared["difference"] = (compared["ours"] - compared["value"]).abs().mask(same, 0.0)
    worst = compared.groupby(["kind", "name"], sort=False)["difference"]
    table = worst.agg(sets="size", largest=lambda part: part.max(skipna=False)).reset_index()
    limits = np.where(table["name"].isin(ODDS), ODDS_TOLERANCE, TOLERANCE)
    named = [NAMED.get(key, "") for key in zip(table["kind"], table["name"], strict=True)]
    table["agrees"] = np.where(table["largest"] <= limits, "yes", [each or "NO" for each in named])
    print(table.to_string(index=False, float_format=lambda value: f"{value:.1e}"))
    sys.exit(int((table["agrees"] == "NO").any()))


if __name__ == "__main__":
    main()
