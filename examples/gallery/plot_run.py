"""
A run over time
===============

Distances, angle, state and vibration of a simulated run, as `haptigraph figure --kind timeline` draws them.
"""

from pathlib import Path
from tempfile import mkdtemp

import haptigraph

path = Path(mkdtemp()) / "run.mcap"
settings = ["source.uri=phantom:wrong_place_then_hit", "run.realtime=false", f"recording.path={path}"]
haptigraph.build(haptigraph.load_config(settings=settings)).run()
with haptigraph.RunReader(path) as run:
    run.plot()
