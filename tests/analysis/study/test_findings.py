import pytest
from study_tables import ANALYSIS, PROTOCOL, freeze, simulated_study, write_study

from haptigraph.analysis.study.data_quality import flagged_trials
from haptigraph.analysis.study.figures.learning import learning_figure
from haptigraph.analysis.study.report import write_report
from haptigraph.analysis.study.results import AnalysisPlan, analyse
from haptigraph.analysis.study.tables import read_tables
from haptigraph.analysis.study.writing.findings import findings, warnings

QUALITY = "[quality]\nmin_images_per_s = 20\n"


def read_study(folder, participants, quality="", **columns):
    tables = simulated_study(participants, trials=2)
    tables["trials"] = tables["trials"].assign(**columns)
    return read_tables(freeze(write_study(folder, tables), PROTOCOL + ANALYSIS + quality))


def test_each_hypothesis_has_a_sentence_and_few_participants_can_show_nothing(tmp_path):
    limit, *claims, caution = findings(analyse(read_study(tmp_path / "few", 2), AnalysisPlan()))
    assert limit == "With 2 participants the smallest possible p is 0.5: these data cannot show an effect."
    assert len(claims) == 3 and claims[0].startswith(
        "Alignment Angle with “Eyes & hands” is smaller than that with"
    )
    assert caution == "A hypothesis that is not supported is not thereby refuted."
    assert all(": not supported (p = " in claim for claim in claims)
    many = findings(analyse(read_study(tmp_path / "many", 12), AnalysisPlan()))
    assert "supported (p " in many[0]


@pytest.mark.parametrize("is_confounded", [False, True])
def test_the_report_begins_with_what_makes_its_results_doubtful(tmp_path, is_confounded):
    tables = read_study(tmp_path / "study", 2, QUALITY, images_per_s=9.0)
    if is_confounded:
        tables.trials["target"] = tables.trials["condition"].map({"visual": "left", "visual_haptic": "right"})
    results = analyse(tables, AnalysisPlan())
    found = warnings(results, flagged_trials(tables, results))
    assert found[-1].startswith(
        "Data quality: 8 of the 8 analysed runs are beyond a threshold of the protocol"
    )
    assert len(found) == 1 + is_confounded
    if is_confounded:
        assert "target: left only under Eyes; right only under Eyes & hands." in found[0]
        assert "condition cannot be separated from target" in str(results.unmodelled)


def test_the_page_and_the_methods_of_a_tiny_study_promise_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr("haptigraph.analysis.study.report.draw_figures", lambda *_: [])  # which take seconds
    read_study(tmp_path / "study", 2, QUALITY, images_per_s=9.0)
    written = write_report(tmp_path / "study", tmp_path / "report")
    head = written.page.read_text().partition("<table>")[0]
    assert "analysed runs are beyond a threshold" in head and "these data cannot show an effect" in head
    assert "these data cannot show an effect" in written.summary
    methods = (tmp_path / "report" / "methods.txt").read_text()
    assert "Power is not reported, because there are too few values." in methods
    assert "2 participants are too few" in methods and "± -" not in written.page.read_text()


@pytest.mark.parametrize(("participants", "is_pale"), [(2, False), (8, True)])
def test_the_legend_of_learning_curves_shows_what_is_drawn(tmp_path, participants, is_pale):
    results = analyse(read_study(tmp_path, participants), AnalysisPlan())
    figure = learning_figure(results, "")
    drawn = [line for line in figure.axes[0].lines if len(line.get_xdata())]
    keys = figure.legends[0].get_lines() if figure.legends else figure.axes[0].get_legend().get_lines()
    assert (
        any(
            (line.get_linewidth(), line.get_markersize(), line.get_alpha())
            == (keys[0].get_linewidth(), keys[0].get_markersize(), keys[0].get_alpha())
            for line in drawn
        )
        is not is_pale
    )
