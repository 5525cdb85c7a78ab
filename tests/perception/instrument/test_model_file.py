import numpy as np
import pytest

from haptigraph.errors import BadInput
from haptigraph.perception.instrument.finding import find_instrument
from haptigraph.perception.instrument.model_file import fingerprint, load_instrument, save_instrument


@pytest.fixture
def saved(learned, tmp_path):
    path = tmp_path / "needle.npz"
    save_instrument(learned[0], path)
    return path


def changed(path, **values):
    """Write the file again with other arrays; None removes one."""
    with np.load(path) as file:
        arrays = {**{name: file[name] for name in file.files}, **values}
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    return path


def test_a_model_is_read_as_it_was_written(learned, saved):
    model, (volumes, _), _ = learned
    again = load_instrument(saved)
    assert fingerprint(again) == fingerprint(model)
    a, b = find_instrument(volumes[0], model), find_instrument(volumes[0], again)
    np.testing.assert_array_equal(a.tip_mm, b.tip_mm)


def test_a_file_is_overwritten_by_force_only(learned, saved):
    with pytest.raises(BadInput, match="--force"):
        save_instrument(learned[0], saved)
    save_instrument(learned[0], saved, force=True)
    with pytest.raises(BadInput, match=r"ends in \.npz"):
        save_instrument(learned[0], saved.with_suffix(".toml"))


@pytest.mark.parametrize(
    ("values", "problem"),
    [
        ({"format": "another"}, "is not the model of an instrument"),
        ({"version": 2}, "has version 2; valid: 1"),
        ({"axis": None}, "lacks axis"),
        ({"axis": np.zeros(2)}, "axis: expected float64"),
        ({"level": np.array("60")}, "level: expected float64"),
        ({"cost_limit": np.array(np.nan)}, "cost_limit: expected positive numbers"),
        ({"tip_sd_mm": np.array([0.01, 0.0, 0.01])}, "tip_sd_mm: expected positive numbers"),
        ({"level": np.array(61.0)}, "was changed after it was learned"),
    ],
)
def test_what_is_no_valid_model_is_refused_in_a_sentence(saved, values, problem):
    with pytest.raises(BadInput, match=problem) as refused:
        load_instrument(changed(saved, **values))
    assert str(saved) in str(refused.value)


def test_damaged_and_missing_files_are_refused(saved, tmp_path):
    saved.write_bytes(saved.read_bytes()[:-900])
    with pytest.raises(BadInput, match=r"is not a readable \.npz file"):
        load_instrument(saved)
    with pytest.raises(BadInput, match="no such file"):
        load_instrument(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("no model")
    with pytest.raises(BadInput, match=r"is not a readable \.npz file"):
        load_instrument(tmp_path / "text.npz")
