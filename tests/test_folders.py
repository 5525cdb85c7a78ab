import pytest

from haptigraph.errors import BadInput
from haptigraph.folders import new_folder


def test_a_folder_gets_its_name_once_it_is_complete(tmp_path):
    with new_folder(tmp_path / "new") as folder:
        (folder / "file").write_text("content")
        assert not (tmp_path / "new").exists()
    assert (tmp_path / "new" / "file").read_text() == "content"
    assert [path.name for path in tmp_path.iterdir()] == ["new"]


def test_nothing_remains_after_an_error(tmp_path):
    with pytest.raises(KeyError), new_folder(tmp_path / "new") as folder:
        (folder / "file").write_text("content")
        raise KeyError
    assert list(tmp_path.iterdir()) == []


def test_an_existing_folder_and_a_missing_parent_are_refused(tmp_path):
    (tmp_path / "mine").mkdir()
    with pytest.raises(BadInput, match="exists already"), new_folder(tmp_path / "mine"):
        pass
    with pytest.raises(BadInput, match="cannot be written"), new_folder(tmp_path / "none" / "new"):
        pass
