"""What a person at a prompt or in a notebook sees of runs, steps, graphs, procedures and reports."""

import ast
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

import haptigraph
from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.display import VIEWS
from haptigraph.graph import Node, SceneGraph
from haptigraph.importing import load
from haptigraph.messages import Conclusion
from haptigraph.recording.reader import RunReader
from haptigraph.run_report import RunReport

PACKAGE = Path(haptigraph.__file__).parent
FOR_PEOPLE = {"_repr_html_", "_repr_svg_", "_repr_png_", "to_dataframe", "to_xarray"}


@pytest.fixture(scope="module")
def finished(quick_uri, tmp_path_factory):
    """The report and the recording of a run."""
    path = tmp_path_factory.mktemp("run") / "quick.mcap"
    settings = (f"source.uri={quick_uri}", "run.realtime=false", f"recording.path={path}")
    report = assemble.build(load_config(None, settings)).run()
    return report, RunReader(path)


@pytest.fixture
def contact(finished):
    return next(step for step in finished[1] if step.conclusion.state == "retinal_contact")


def test_every_view_exists():
    for path in VIEWS.values():
        assert callable(load(path))


def test_nothing_in_the_package_depends_on_what_people_see():
    """The one way from low layers to `analysis` is a name, so import-linter does not see who uses it."""
    sources = {path.relative_to(PACKAGE).as_posix(): path.read_text() for path in PACKAGE.rglob("*.py")}
    calls = {
        (name, node.func.attr)
        for name, text in sources.items()
        if any(called in text for called in FOR_PEOPLE)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr in FOR_PEOPLE
    }
    assert calls == {("analysis/notebook/tables.py", "_repr_png_")}
    importers = {name for name, text in sources.items() if "from haptigraph.display import" in text}
    assert importers == {
        "analysis/notebook/tables.py", "graph.py", "inference/procedure.py", "messages.py", "recording/reader.py", "run_report.py",
    }  # fmt: skip


def test_reprs_are_short_and_say_what_it_is(finished, contact, procedure):
    report, run = finished
    assert re.fullmatch(r"<RunReader quick.mcap: phantom:\S+quick.toml, 20..-..-.. ..:.. UTC>", repr(run))
    assert re.fullmatch(r"<Step of image \d+ at [\d.]+ s: retinal_contact, plays 'pulse'>", repr(contact))
    assert "<needle_tip, touching, retina_surface>" in repr(contact.graph)
    assert repr(SceneGraph(0)) == "<SceneGraph of 0 nodes: no edge>"
    assert (
        repr(contact.conclusion)
        == f"<Conclusion retinal_contact, feels 'pulse': {contact.conclusion.because}>"
    )
    assert repr(procedure) == f"<Procedure subretinal_injection: 9 states, sha256 {procedure.sha256[:12]}>"
    assert re.fullmatch(rf"<RunReport of {len(run)} steps, \d+ steps/s; source ended>", repr(report))
    report = RunReport(steps=2, faults=report.faults + type(report.faults)({"source: gone": 3}))
    assert ", faults: 3;" in repr(report)


def elements(html: str) -> ElementTree.Element:
    """Parse HTML that is well-formed, and check that nothing in it runs."""
    assert not re.search(r"<script|<iframe|<link|\bon\w+=|javascript:", html)
    closed = re.sub(r"(<img [^>]*)>", r"\1/>", html)
    return ElementTree.fromstring(f"<div>{closed}</div>")


def texts(html: str) -> list[str]:
    return [text for cell in elements(html).iter("td") for text in cell.itertext()]


def test_a_step_is_a_table_with_its_graph(contact):
    html = contact._repr_html_()
    assert contact.conclusion.because in texts(html)
    assert f"{contact.graph.measures['theta_deg']:.3g}" in texts(html)
    assert "touching" in html[html.index("<svg") :]


def test_a_conclusion_and_a_report_are_tables(finished, contact):
    assert "<needle_tip, touching, retina_surface>" in texts(contact.conclusion._repr_html_())
    report = finished[0]
    assert {"source ended", str(report.steps), "none"} <= set(texts(report._repr_html_()))
    assert any(text.startswith("p50 ") for text in texts(report._repr_html_()))
    assert "p50" not in RunReport()._repr_html_()


def test_what_a_table_says_is_text_not_markup():
    conclusion = Conclusion(0, "<b>state</b>", 1, "low", "<img src=x> & more")
    html = conclusion._repr_html_()
    assert "<img src=x> & more" in texts(html)
    assert "<img" not in html
    assert "<b>state" not in html


def test_a_graph_and_a_procedure_are_diagrams(contact, procedure):
    for shown in (contact.graph, procedure):
        assert ElementTree.fromstring(shown._repr_svg_()).tag.endswith("svg")
        assert shown._repr_svg_() == shown._repr_svg_()
    assert "retinal" in procedure._repr_svg_()
    assert "nothing was detected" in SceneGraph(0)._repr_svg_()
    assert ElementTree.fromstring(SceneGraph(0, (Node("a", "b", "c"),))._repr_svg_()) is not None


def test_a_run_is_its_header_and_its_timeline(finished):
    run = finished[1]
    html = run._repr_html_()
    assert {"complete", "subretinal_injection", str(len(run))} <= set(texts(html))
    assert 'src="data:image/png;base64,' in html


def test_plots_are_figures_that_a_notebook_shows(finished, contact):
    from matplotlib.figure import Figure

    figure = finished[1].plot()
    assert isinstance(figure, Figure)
    assert [axes.get_title(loc="left") for axes in figure.axes] or figure.axes
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert isinstance(contact.graph.plot(), Figure)
