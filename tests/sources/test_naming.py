import pytest

from haptigraph.assemble import SOURCES
from haptigraph.config import Config
from haptigraph.sources.naming import SIMULATED, split_source


@pytest.mark.parametrize("kind", SIMULATED)
def test_a_simulated_eye_without_a_name_is_that_of_the_default_scenario(kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / kind).mkdir()  # ./phantom names the folder
    assert split_source(kind, SOURCES) == (kind, split_source(Config().source.uri, SOURCES)[1])
    assert split_source(f"./{kind}", SOURCES) == ("images", f"./{kind}")
