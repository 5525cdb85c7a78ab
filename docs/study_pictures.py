"""Simulate two studies, and update the documentation's figures and the tables in simulated_comparison.md.

The studies are the paper's protocol and examples/three_touches, with simulated participants only. Takes some
minutes; with --folder FOLDER the studies and reports are kept, and an interrupted run is resumed.
"""

import argparse
import math
import os
import shutil
import sys
import tempfile
from contextlib import closing
from importlib import resources
from pathlib import Path

import pandas as pd

from haptigraph.analysis.study.measures import measure_study
from haptigraph.analysis.study.report import write_report
from haptigraph.commands.terminal import progress_bar
from haptigraph.study.exchange.exporting import export_study
from haptigraph.study.protocol import load_protocol
from haptigraph.study.simulated.player import SimulationSpec
from haptigraph.study.simulated.simulation import simulate
from haptigraph.study.store import Store

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS.parent / "benchmarks"))
from touch_comparison import p_value, renew  # noqa: E402

PAPER = Path(str(resources.files("haptigraph.study"))) / "templates" / "study.toml"
THREE = DOCS.parent / "examples" / "three_touches" / "study.toml"
SHOWN = ("rainclouds", "state_times", "state_sequence", "depth_theta")
SEED = 1
REPORTED = {
    "completion_s": ("completion time (s)", 1),
    "mean_theta_deg": ("mean theta (deg)", 1),
    "sus": ("SUS (random answers)", 1),
    "time_misaligned_retinal_approach_s": ("misaligned near the retina (s)", 1),
    "time_aligned_intraocular_navigation_s": ("aligned before the approach (s)", 1),
    "path_mm": ("path (mm)", 1),
    "vibrating_s": ("time vibrating (s)", 1),
}
"""Label and decimals by measure."""


def main() -> None:
    """Simulate, report, and update docs/."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, help="a folder for studies and reports")
    folder = parser.parse_args().folder
    with tempfile.TemporaryDirectory() as place:
        folder = folder or Path(place)
        tables = {name: rehearse(folder / name, text) for name, text in (("paper", PAPER), ("three", THREE))}
        for name in SHOWN:
            picture = folder / "paper" / "report" / "figures" / f"{name}.png"
            shutil.copy(picture, DOCS / "images" / f"study-{name.replace('_', '-')}.png")
    tables = {f"study {name}": table for name, table in tables.items()}
    renew(DOCS / "explanation" / "simulated_comparison.md", tables, "make rehearse")


def rehearse(folder: Path, protocol_file: Path) -> str:
    """Simulate and report a study in a folder; return its comparisons as Markdown."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(protocol_file, folder / "study.toml")
    protocol, where = load_protocol(folder), str(folder / "study.db")
    with progress_bar() as progress:
        count = protocol.study.participants
        spec = SimulationSpec(str(folder), where, SEED)
        done = simulate(spec, count, workers=os.cpu_count() or 1, progress=progress)
        print(f"{protocol.study.name}: {done.trials} trials, {done.steered_s / 60:.0f} simulated minutes")
        shutil.rmtree(folder / "tables", ignore_errors=True)
        with closing(Store(where)) as store:
            measure_study(store, protocol.study.name, folder, progress)
            export_study(store, protocol.study.name, folder / "tables")
        write_report(folder / "tables", folder / "report", recordings=folder, progress=progress)
    table = comparisons(folder / "report" / "csv" / "comparisons.csv")
    print(table)
    return table


def comparisons(path: Path) -> str:
    """Return the comparisons of a report as Markdown, a row each."""
    lines = [
        "| measure | compared | first | second | p | p (Holm) | r [95 %] |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    found = pd.read_csv(path)
    for row in found[found["measure"].isin(REPORTED)].to_dict("records"):
        label, digits = REPORTED[row["measure"]]
        first, second = (
            f"{float(row[f'mean_{one}']):.{digits}f} ± {float(row[f'sd_{one}']):.{digits}f}"
            for one in ("first", "second")
        )
        p, holm = ("" if math.isnan(row[name]) else p_value(row[name]) for name in ("p", "p_holm"))
        effect = "" if math.isnan(row["r"]) else f"{row['r']:+.2f}"
        if not math.isnan(row["r_low"]):  # few participants leave it open
            effect += f" [{row['r_low']:+.2f}, {row['r_high']:+.2f}]"
        pair = f"{row['first']} → {row['second']}".replace("_", " ")
        lines.append(f"| {label} | {pair} | {first} | {second} | {p} | {holm} | {effect} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
