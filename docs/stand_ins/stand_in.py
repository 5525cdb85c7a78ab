"""What stands in for something that a reader has, and where the parts of the tests are that do."""

import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
"""In which `haptigraph` is this one."""
SUPPORT = ROOT / "tests" / "support"
sys.path += [
    *(str(folder) for folder in (SUPPORT, SUPPORT / "boards", SUPPORT / "force")),
    *(str(folder) for folder in (ROOT / "tests" / "ros2", ROOT / "benchmarks")),
]


@dataclass(frozen=True, kw_only=True)
class StandIn:
    """What stands in: texts of the page and what to run instead, and how to stop it."""

    replaced: Mapping[str, str] = field(default_factory=dict)
    stop: Callable[[], object] = lambda: None
