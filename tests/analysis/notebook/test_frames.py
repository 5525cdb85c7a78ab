import builtins
import csv

import pytest

from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.errors import MissingExtra
from haptigraph.recording.reader import RunReader

pd = pytest.importorskip("pandas")


@pytest.fixture(scope="module")
def run(quick_uri, tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "quick.mcap"
    settings = (f"source.uri={quick_uri}", "run.realtime=false", f"recording.path={path}")
    assemble.build(load_config(None, settings)).run()
    return RunReader(path)


def test_a_dataframe_has_a_row_per_step_indexed_by_time(run):
    table = run.to_dataframe()
    assert len(table) == len(run)
    assert table.index.name == "time_s"
    assert list(table["state"]) == [step.conclusion.state for step in run]
    for number in (0, 40, 90):
        assert run.at_s[table.index[number]] == run[number]
    for name in ("theta_deg", "distance_to_retina_mm"):
        measured = [step.graph.measures.get(name) for step in run]
        assert [None if pd.isna(value) else value for value in table[name]] == measured
    assert table.loc[2.5:3.5].index.min() >= 2.5


def test_it_says_units_meanings_and_what_the_run_was(run):
    attrs = run.to_dataframe().attrs
    assert attrs["units"]["theta_deg"] == "deg"
    assert attrs["meanings"].keys() >= attrs["units"].keys()
    assert attrs["procedure"] == "subretinal_injection"
    assert attrs["procedure_sha256"] == run.info.procedure_sha256


def test_states_are_in_the_order_of_priority(run, procedure):
    states = run.to_dataframe()["state"].cat
    assert states.ordered
    assert list(states.categories) == [state.name for state in procedure.states]


def test_what_is_not_known_is_missing_and_never_zero(run):
    table = run.to_dataframe()
    unknown = table[table["state"] == "unknown"]
    assert len(unknown) > 0
    assert unknown["theta_deg"].isna().all()
    assert table["robot_x_mm"].isna().all()


def test_columns_and_values_are_those_of_the_exported_table(run, tmp_path):
    exporting = pytest.importorskip("haptigraph.analysis.exporting.csv_table")
    exporting.run_csv(run.path, tmp_path / "run.csv")
    table = run.to_dataframe().reset_index()
    with open(tmp_path / "run.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert sorted(rows[0]) == sorted(table.columns)
    for row, (_, ours) in zip(rows, table.iterrows(), strict=True):
        for name in ("time_s", "theta_deg", "needle_tip_x_mm"):
            assert (row[name] == "") == pd.isna(ours[name])
            assert row[name] == "" or float(row[name]) == ours[name]
        assert row["relations"] == ours["relations"]


def test_an_xarray_dataset_has_the_same_values_with_units(run, tmp_path):
    pytest.importorskip("xarray")
    table, variables = run.to_dataframe(), run.to_xarray()
    assert variables.sizes == {"time_s": len(run)}
    assert set(variables) == set(table)
    assert variables["theta_deg"].attrs["units"] == "deg"
    assert variables["time_s"].attrs["units"] == "s"
    assert variables["theta_deg"].to_series().equals(table["theta_deg"])
    assert variables["stamp_ns"].dtype == "int64"
    assert str(variables["utc"].dtype).startswith("datetime64")
    assert variables.attrs["procedure_sha256"] == run.info.procedure_sha256
    inside = variables.sel(time_s=slice(2.5, 4))
    assert list(inside["step"]) == [number for number in range(len(run)) if 2.5 <= table.index[number] <= 4]


@pytest.mark.parametrize(("missing", "call"), [("pandas", "to_dataframe"), ("xarray", "to_xarray")])
def test_a_missing_library_is_named_with_its_extra(run, monkeypatch, missing, call):
    real = builtins.__import__

    def without(name, *arguments, **options):
        if name == missing:
            raise ModuleNotFoundError(name)
        return real(name, *arguments, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtra, match=rf"RunReader.{call} needs an extra; .*haptigraph\[notebook\]"):
        getattr(run, call)()
