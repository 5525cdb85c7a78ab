import pytest

from haptigraph.analysis.evaluation.ground_truth import TruthRow, load_truth, truth_text
from haptigraph.errors import BadInput


def test_invalid_ground_truth_is_refused_with_its_line(tmp_path):
    file = tmp_path / "truth.csv"
    with pytest.raises(BadInput, match="cannot be read"):
        load_truth(file)
    header = "image,time_s,visible,inside,tip_x_px,tip_y_px,depth_mm,theta_deg,state\n"
    file.write_text(header + "0,0,1,1,1,2,3,4,a\n1,0,1,1,one,2,3,4,a\n")
    with pytest.raises(BadInput, match="line 3: tip_x_px: not a finite number: 'one'"):
        load_truth(file)
    file.write_text("image,visible\n0,1\n")
    with pytest.raises(BadInput, match=r"column '.*' is missing"):
        load_truth(file)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (b"0,0,1,1,nan,2,3,4,a", "line 3: tip_x_px: not a finite number: 'nan'"),
        (b"0,0,1,1,1,2,3,-inf,a", "line 3: theta_deg: not a finite number: '-inf'"),
        (b"0,0,yes,1,1,2,3,4,a", "line 3: visible: expected 0 or 1, found 'yes'"),
        (b"0,0,1,,1,2,3,4,a", "line 3: inside: expected 0 or 1, found ''"),
        (b"0,0,1,1,1,2,3,4,aa", "line 3: unknown state 'aa'; did you mean 'a'? valid: a, b"),
        (b"0,0,1,1,1,2,3,4", "line 3: fewer values than columns"),
        (b"0,0,1,1,1,2,3,4,a,5", "line 3: more values than columns"),
        (b'0,0,1,1,1,2,3,4,"a', "line 3: unexpected end of data"),
        (b"0,0,1,1,1,2,3,4,\xe9", "not UTF-8 text"),
    ],
)
def test_an_invalid_row_is_refused_in_one_sentence(tmp_path, line, expected):
    file = tmp_path / "truth.csv"
    header = b"image,time_s,visible,inside,tip_x_px,tip_y_px,depth_mm,theta_deg,state\n"
    file.write_bytes(header + b"0,0,0,0,,,,,b\n" + line)
    with pytest.raises(BadInput) as refused:
        load_truth(file, ["a", "b"])
    assert expected in str(refused.value)
    assert str(refused.value).startswith(str(file))


def test_written_rows_are_read_unchanged(tmp_path):
    file = tmp_path / "truth.csv"
    rows = [
        TruthRow(False, False, None, None, None, "a"),
        TruthRow(True, False, (1.25, -3.5), -2.125, 0.0, "b"),
        TruthRow(True, True, (640.0, 359.5), 20.5, 1.75, "a"),
    ]
    file.write_text(truth_text(rows, 30))
    assert load_truth(file, ["a", "b"]) == rows
    assert file.read_text().splitlines()[3].startswith("2,0.0667,1,1,")
