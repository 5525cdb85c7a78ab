"""haptigraph: every image becomes a scene graph, the graph a surgical state, the state haptic feedback.

    import haptigraph

    config = haptigraph.load_config(settings=["source.uri=phantom:align_then_approach", "run.realtime=false"])
    loop = haptigraph.build(config)
    state = ""
    for step in loop.steps():  # image in, haptic feedback out
        if step.conclusion.state != state:
            state = step.conclusion.state
            print(f"{step.stamp_ns / 1e9:5.1f} s  {state}: {step.conclusion.because}")
            print(f"         haptic output: {step.command.pattern.name!r}")
    print(f"{loop.report.rate_hz:.0f} images/s")

Research software, not a medical device.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from haptigraph.version import __version__

if TYPE_CHECKING:
    from haptigraph.assemble import build, load_procedure
    from haptigraph.config import Config, load_config
    from haptigraph.errors import HaptigraphError
    from haptigraph.graph import SceneGraph, Triplet
    from haptigraph.messages import Capture, Step
    from haptigraph.recording.reader import RunReader
    from haptigraph.registration.loading import load_registration

__all__ = [
    "Capture",
    "Config",
    "HaptigraphError",
    "RunReader",
    "SceneGraph",
    "Step",
    "Triplet",
    "__version__",
    "build",
    "load_config",
    "load_procedure",
    "load_registration",
]

_MODULES = {
    "Capture": "messages",
    "Config": "config",
    "HaptigraphError": "errors",
    "RunReader": "recording.reader",
    "SceneGraph": "graph",
    "Step": "messages",
    "Triplet": "graph",
    "build": "assemble",
    "load_config": "config",
    "load_procedure": "assemble",
    "load_registration": "registration.loading",
}


if not TYPE_CHECKING:  # or else type checkers would accept any name

    def __getattr__(name: str) -> Any:
        """Import a public name on first use, so that the command line starts fast."""
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    """List the public names, loaded or not, for tab completion."""
    return __all__
