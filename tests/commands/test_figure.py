"""The command `figure`."""

from evidence_files import record
from helpers import call, refuse


def test_a_figure_is_written(quick_uri, tmp_path):
    run = record(quick_uri, tmp_path / "run.mcap")
    result = call("figure", run, "--kind", "timeline", "-o", tmp_path / "timeline.pdf")
    assert result.exit_code == 0, result.output
    assert result.output.strip() == str(tmp_path / "timeline.pdf")
    assert (tmp_path / "timeline.pdf").read_bytes().startswith(b"%PDF")
    assert "exists already" in refuse("figure", run, "--kind", "timeline", "-o", tmp_path / "timeline.pdf")


def test_what_is_no_recording_is_refused(tmp_path):
    (tmp_path / "run.mcap").write_text("nothing")
    assert "run.mcap" in refuse("figure", tmp_path / "run.mcap", "--kind", "views", "-o", tmp_path / "a.pdf")
