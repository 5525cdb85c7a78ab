"""A recorded run as a pandas DataFrame or an xarray Dataset, with the columns of an export."""

from typing import TYPE_CHECKING, Any

from haptigraph.analysis.exporting.columns import Column, RunTable
from haptigraph.errors import MissingExtra
from haptigraph.recording.reader import RunReader

if TYPE_CHECKING:
    import pandas
    import xarray

__all__ = ["run_dataframe", "run_xarray"]

HEADER = (
    "version",
    "started_utc",
    "source",
    "participant",
    "trial",
    "procedure_sha256",
    "registration_sha256",
)


def run_dataframe(run: RunReader) -> "pandas.DataFrame":
    """Return a run as a table: one row a step, indexed by `time_s`.

    Raises:
        BadInput: If the recording is damaged, or has no complete step.
        MissingExtra: If pandas is not installed.
    """
    try:
        import pandas as pd  # noqa: PLC0415 - an extra
    except ModuleNotFoundError:
        raise MissingExtra("RunReader.to_dataframe", "notebook") from None
    table = RunTable(run.path, run.path.stem)
    rows = list(table.rows())
    data = pd.DataFrame(
        {
            column.name: pd.Series([_cell(column, column.value(row)) for row in rows], dtype=_dtype(column))
            for column in table.columns
        }
    )
    states = [state.name for state in table.procedure.states]
    data["state"] = pd.Categorical(data["state"], states, ordered=True)
    data = data.set_index("time_s")
    data.attrs = {
        "units": {column.name: column.unit for column in table.columns if column.unit},
        "meanings": {column.name: column.meaning for column in table.columns},
        "procedure": table.procedure.name,
        **{name: getattr(run.info, name) for name in HEADER},
    }
    return data


def run_xarray(run: RunReader) -> "xarray.Dataset":
    """Return a run as variables over `time_s`, each with its unit and meaning as attributes.

    Raises:
        BadInput: If the recording is damaged, or has no complete step.
        MissingExtra: If xarray or pandas is not installed.
    """
    try:
        import xarray as xr  # noqa: PLC0415 - an extra
    except ModuleNotFoundError:
        raise MissingExtra("RunReader.to_xarray", "notebook") from None
    table = run_dataframe(run)
    whole = {name for name in table.select_dtypes("Int64") if table[name].notna().all()}
    plain = {name: "int64" if name in whole else "float64" for name in table.select_dtypes("Int64")}
    table["utc"] = table["utc"].dt.tz_localize(None)  # as NumPy has no time zones
    variables = xr.Dataset.from_dataframe(table.astype({"state": "object", **plain}))
    units, meanings = table.attrs.pop("units"), table.attrs.pop("meanings")
    for name, variable in variables.variables.items():
        variable.attrs = {"units": units.get(name, ""), "long_name": meanings[name]}
    variables.attrs = table.attrs
    return variables


def _dtype(column: Column) -> Any:
    if column.name == "utc":
        return "datetime64[us, UTC]"
    return {"integer": "Int64", "number": "float64"}.get(column.kind, "object")


def _cell(column: Column, value: Any) -> Any:
    return "; ".join(value) if column.kind == "texts" else value
