"""
A vibration
===========

Amplitude and frequency of a haptic pattern over time: the alarm of subretinal injection.
``haptigraph touch draw subretinal_injection:pulse`` writes the same.
"""

from haptigraph.analysis.touch.figure import draw_touch
from haptigraph.analysis.touch.loading import load_touch

draw_touch(load_touch("subretinal_injection:pulse", length_ms=1000), "pulse.png")
