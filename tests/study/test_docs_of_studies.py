import runpy

from paths import ROOT


def test_the_tables_of_a_rehearsal_leave_out_what_was_not_tested(tmp_path):
    columns = "measure,first,second,mean_first,sd_first,mean_second,sd_second,p,p_holm,r,r_low,r_high\n"
    (tmp_path / "comparisons.csv").write_text(
        columns + "mean_theta_deg,seen,felt,8.1,4.6,4.8,2.9,0.058,0.0001,-0.54,,\n"
        "path_mm,seen,felt,21,0,21,0,,,,,\n"
    )
    comparisons = runpy.run_path(str(ROOT / "docs" / "study_pictures.py"))["comparisons"]
    assert comparisons(tmp_path / "comparisons.csv").splitlines()[2:] == [
        "| mean theta (deg) | seen → felt | 8.1 ± 4.6 | 4.8 ± 2.9 | 0.058 | < 0.001 | -0.54 |",
        "| path (mm) | seen → felt | 21.0 ± 0.0 | 21.0 ± 0.0 |  |  |  |",
    ]
