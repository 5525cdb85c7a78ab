"""Figures of a run: every kind in every format, with letters, legends and scale bars, and what is refused."""

import re
from collections.abc import Callable, Iterator
from functools import cache
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from helpers import mostly_slow
from matplotlib.figure import Figure
from matplotlib.text import Text

from haptigraph.analysis.paper import figure as figures
from haptigraph.analysis.paper import zones
from haptigraph.analysis.paper.figure import KINDS, paper_figure
from haptigraph.analysis.plots.paper import save
from haptigraph.errors import BadInput

LETTERS = {"pipeline": "abcdefghijkl", "views": "abc", "timeline": "abcd"}


@pytest.fixture(scope="module", autouse=True)
def coarse_zones() -> Iterator[None]:
    """Conclude the state at each sixteenth place only; the zones themselves are tested elsewhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(zones, "STEP_PX", 4 * zones.STEP_PX)
        yield


@pytest.fixture(scope="module")
def kept() -> Iterator[list[Figure]]:
    """All figures that were written."""
    figures_kept: list[Figure] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            figures, "save", lambda figure, *output: figures_kept.append(figure) or save(figure, *output)
        )
        yield figures_kept


@pytest.fixture
def unsaved(monkeypatch) -> list[Figure]:
    """All figures that would have been written, which takes most of the time."""
    figures_kept: list[Figure] = []
    monkeypatch.setattr(figures, "save", lambda figure, *output: figures_kept.append(figure))
    return figures_kept


@pytest.fixture(scope="module")
def drawn(run, kept, tmp_path_factory) -> Callable[[str], tuple[Figure, bytes]]:
    """Draws every kind once: returns the figure and its PDF."""

    @cache
    def draw(kind: str) -> tuple[Figure, bytes]:
        path = tmp_path_factory.mktemp(kind) / "figure.pdf"
        paper_figure(run, kind, path)
        return kept[-1], path.read_bytes()

    return draw


def texts(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.findobj(match=Text)]


def bars(axes) -> list:
    return [line for line in axes.lines if line.get_linewidth() == 1.8]


@pytest.mark.parametrize("kind", KINDS)
def test_every_panel_has_its_letter(drawn, kind):
    figure, _ = drawn(kind)
    assert "simulated" in texts(figure)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert "".join(re.findall(r"bf\{(\w)\}", " ".join(titles))) == LETTERS[kind]


@pytest.mark.parametrize("kind", KINDS)
def test_every_line_is_in_a_legend(drawn, kind):
    figure, _ = drawn(kind)
    for axes in figure.axes:
        labels = axes.get_legend_handles_labels()[1]
        legends = [legend for legend in (axes.get_legend(), *figure.legends) if legend is not None]
        shown = {text.get_text() for legend in legends for text in legend.get_texts()}
        assert set(labels) <= shown | {"amplitude"}


def test_pictures_have_scale_bars_of_the_right_length(drawn, registration):
    figure, _ = drawn("views")
    raw, displayed, zone = figure.axes
    lengths = {axes: [np.ptp(line.get_xdata()) for line in bars(axes)] for axes in (raw, displayed, zone)}
    assert all(len(each) == 1 for each in lengths.values())
    assert lengths[displayed] == pytest.approx(lengths[zone])
    assert lengths[displayed][0] == pytest.approx(480 * 5 / (2 * registration.view_half_mm), rel=0.05)
    assert texts(figure).count("5 mm") == 3


@pytest.mark.parametrize("kind", mostly_slow(KINDS, "timeline"))
def test_equal_runs_give_equal_bytes_and_fonts_are_embedded(run, tmp_path, drawn, kind):
    paper_figure(run, kind, tmp_path / "other.pdf")
    _, one = drawn(kind)
    assert one == (tmp_path / "other.pdf").read_bytes()
    assert b"/FontFile2" in one and b"/Type3" not in one


def test_svg_and_png_are_written_too(run, tmp_path):
    paper_figure(run, "pipeline", tmp_path / "pipeline.svg")
    assert ElementTree.parse(tmp_path / "pipeline.svg").getroot().tag.endswith("svg")
    paper_figure(run, "timeline", tmp_path / "timeline.png")
    assert cv2.imread(str(tmp_path / "timeline.png")).shape[1] > 2000


def test_without_a_time_an_alarm_is_shown(drawn):
    figure, _ = drawn("views")
    assert any("displayed: retinal contact" in text for text in texts(figure))


def test_a_time_chooses_the_step(run, tmp_path, unsaved):
    paper_figure(run, "views", tmp_path / "views.pdf", at_s=1.0)
    title = unsaved[-1].axes[0].get_title(loc="left")
    assert 0.9 < float(re.search(r"([\d.]+) s", title)[1]) <= 1.0


@pytest.mark.parametrize(
    ("kind", "at_s", "problem"),
    [
        ("views", 1e6, r"no step at 1e\+06 s; valid: 0 to"),
        ("pipeline", -1, "no step at -1 s"),
        ("timeline", 1, "--at goes with --kind pipeline and views"),
    ],
)
def test_times_that_do_not_fit_are_refused(run, tmp_path, kind, at_s, problem):
    with pytest.raises(BadInput, match=problem):
        paper_figure(run, kind, tmp_path / "figure.pdf", at_s=at_s)


def test_an_image_without_a_needle_has_no_pipeline(run, tmp_path):
    with pytest.raises(BadInput, match="no needle is detected in an image at"):
        paper_figure(run, "pipeline", tmp_path / "figure.pdf", at_s=0.8)


def test_b_scans_have_a_timeline_only(scan_run, tmp_path, unsaved):
    paper_figure(scan_run, "timeline", tmp_path / "timeline.svg")
    assert len(unsaved) == 1
    for kind in ("pipeline", "views"):
        with pytest.raises(BadInput, match="shows runs with a camera and a needle"):
            paper_figure(scan_run, kind, tmp_path / "figure.pdf")


def test_nothing_is_overwritten(run, tmp_path):
    (tmp_path / "figure.pdf").write_text("mine")
    with pytest.raises(BadInput, match="exists already"):
        paper_figure(run, "timeline", tmp_path / "figure.pdf")
    with pytest.raises(BadInput, match="valid endings"):
        paper_figure(run, "timeline", tmp_path / "figure.gif")


def test_a_timeline_compares_with_another_procedure(run, procedure, tmp_path, unsaved):
    paper_figure(run, "timeline", tmp_path / "both.pdf", procedure="subretinal_injection_cautious")
    assert (
        sum("subretinal_injection_cautious" in axes.get_title(loc="left") for axes in unsaved[-1].axes) == 2
    )
    (tmp_path / "mine.toml").write_text(procedure.text.replace("= 1.7", "= 3.0"))  # of the same name
    paper_figure(run, "timeline", tmp_path / "mine.pdf", procedure=str(tmp_path / "mine.toml"))
    assert sum(axes.get_title(loc="left").endswith(", mine.toml") for axes in unsaved[-1].axes) == 2
    with pytest.raises(BadInput, match="--procedure goes with --kind timeline"):
        paper_figure(run, "views", tmp_path / "views.pdf", procedure="subretinal_injection_cautious")
    with pytest.raises(BadInput, match="nowhere"):
        paper_figure(run, "timeline", tmp_path / "none.pdf", procedure="nowhere")
