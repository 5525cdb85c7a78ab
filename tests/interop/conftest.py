import pytest
from paths import ROOT
from ros_network import loopback

ENVIRONMENTS = ROOT / ".interop"


@pytest.fixture(scope="module", params=["jazzy", "kilted"])
def distribution(request):
    """The name of a ROS 2 distribution and its Python, on a network of this machine alone."""
    python = ENVIRONMENTS / request.param / "bin" / "python"
    if not python.exists():
        pytest.skip(f"ROS 2 {request.param} is not installed; run `make interop`")
    with pytest.MonkeyPatch.context() as patch:
        for name, value in loopback(ignored="1.15").items():  # without a tag, which only Cyclone supports
            patch.setenv(name, value)
        yield request.param, python
