import gc
import hashlib
import json
import shutil
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import pytest
from helpers import remembered
from matplotlib.figure import Figure
from matplotlib.text import Text
from paths import GOLDEN
from study_tables import simulated_study, write_study

from haptigraph.analysis.study import results
from haptigraph.analysis.study.figures.style import ONE_COLUMN_MM, TWO_COLUMNS_MM

STATISTICS = {name: remembered(getattr(results, name)) for name in ("order_effects", "compare")}


@pytest.fixture(scope="module", autouse=True)
def statistics_once() -> Iterator[None]:
    """Compute slow statistics once for the same data, which many reports of these tests share.

    Whether a second program computes the same is tested by the script of a bundle.
    """
    with pytest.MonkeyPatch.context() as patch:
        for name, function in STATISTICS.items():
            patch.setattr(results, name, function)
        yield


@pytest.fixture(scope="module", autouse=True)
def earlier_objects_stay() -> None:
    """Keep the objects of earlier tests out of the garbage collection at each correction of p-values."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def study(tmp_path_factory) -> Path:
    """A small simulated study whose first two participants have recordings of the phantom; one run is slow.

    Read-only.
    """
    tables, folder = simulated_study(participants=8, trials=2), tmp_path_factory.mktemp("recorded") / "study"
    trials = tables["trials"]
    trials["recording"], trials["recording_sha256"] = "", ""
    trials["procedure_sha256"], trials["software"] = "", "0.1.0"
    (folder / "recordings").mkdir(parents=True)
    for condition, name in (("visual", "wrong_place_then_hit"), ("visual_haptic", "align_then_approach")):
        shutil.copy(GOLDEN / f"{name}.mcap", folder / "recordings")
        rows = (
            (trials["condition"] == condition)
            & trials["participant"].isin(["S01", "S02"])
            & (trials["trial"] == 1)
        )
        trials.loc[rows, "recording"] = f"recordings/{name}.mcap"
        digest = hashlib.sha256((GOLDEN / f"{name}.mcap").read_bytes()).hexdigest()
        trials.loc[rows, "recording_sha256"] = digest
    trials["images_per_s"] = 30.0
    trials.loc[trials.index[trials["phase"] == "trial"][0], "images_per_s"] = 9.0
    write_study(folder, tables)
    protocol = {"study.toml": "[quality]\nmin_images_per_s = 20\n"}
    (folder / "study.json").write_text(json.dumps({"parts": protocol}))
    return folder


@pytest.fixture
def check_print():
    return refuse_unprintable


SMALLEST_PT = 6.5


def refuse_unprintable(figure: Figure, note: str) -> None:
    """Refuse what a journal would: another width, small text, texts that overlap, or are cut off; and a title."""
    figure.draw_without_rendering()
    width_mm = 25.4 * figure.get_figwidth()
    assert min(abs(width_mm - column) for column in (ONE_COLUMN_MM, TWO_COLUMNS_MM)) < 1e-6
    assert figure.get_suptitle() == note
    texts = _shown_texts(figure)
    assert min(text.get_fontsize() for text in texts) >= SMALLEST_PT
    extents = {text: text.get_window_extent().padded(-0.3) for text in texts}
    for one, other in combinations(texts, 2):
        overlap = extents[one].overlaps(extents[other])
        assert not overlap, f"{one.get_text()!r} overlaps {other.get_text()!r}"
    drawn = figure.get_tightbbox()
    assert drawn.x0 >= 0 and drawn.y0 >= 0
    assert drawn.x1 <= figure.get_figwidth() and drawn.y1 <= figure.get_figheight()


def _shown_texts(figure: Figure) -> list[Text]:
    """The texts that are drawn: of ticks, those within the limits."""
    ticks, inside = set(), []
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        low, high = sorted(axis.get_view_interval())
        for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
            ticks |= {tick.label1, tick.label2}
            inside += [tick.label1] if low <= tick.get_loc() <= high and axis.axes.axison else []
    others = [text for text in figure.findobj(Text) if text not in ticks]
    return [text for text in [*others, *inside] if text.get_visible() and text.get_text().strip()]
