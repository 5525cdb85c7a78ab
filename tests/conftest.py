"""Shared fixtures. The eye of the tests is the simulator's; clips beside the checkout are used where present."""

from pathlib import Path

import pytest
from hypothesis import settings

from haptigraph.assemble import load_procedure
from haptigraph.geometry import ImageGeometry
from haptigraph.inference.procedure import Procedure
from haptigraph.perception.registration import Registration, parse_registration
from haptigraph.sim.eye import Eye, EyeShape, registration_text

# The same examples on every machine; `make fuzz` looks for new ones.
settings.register_profile("haptigraph", deadline=None, derandomize=True)
settings.register_profile("fuzz", deadline=None, max_examples=3000)
settings.load_profile("haptigraph")

DATA = Path(__file__).parent / "data"
CLIPS = Path(__file__).parents[2] / "shared" / "clips"


@pytest.fixture(scope="session")
def quick() -> str:
    """The path of a short scenario in small pictures."""
    return str(DATA / "quick.toml")


@pytest.fixture(scope="session")
def quick_uri(quick: str) -> str:
    return f"phantom:{quick}"


@pytest.fixture(scope="session")
def procedure() -> Procedure:
    return load_procedure("subretinal_injection")


@pytest.fixture(scope="session")
def registration_toml() -> str:
    geometry = ImageGeometry(center_px=(160.0, 120.0), mm_per_px=1 / 8, mirrored=True)
    return registration_text(Eye(EyeShape()), geometry, 320, 240)


@pytest.fixture(scope="session")
def registration(registration_toml: str) -> Registration:
    return parse_registration(registration_toml, "registration.toml")


@pytest.fixture(params=["A_easy", "B_dark"])
def clip(request: pytest.FixtureRequest) -> Path:
    folder = CLIPS / request.param
    if not folder.is_dir():
        pytest.skip(f"{folder} is not here")
    return folder
