"""Protocols of small studies."""

SMALL = """
[study]
name = "small"
title = "A small study"
design = "within"
participants = 4
seed = 1

[texts]
briefing = "Hit the target."
consent = "I agree."
break_text = "Rest."

[trials]
repetitions = 2
attempts = 2

[training]
before = "study"
condition = "felt"
timeout_s = 60

[[condition]]
name = "seen"
title = "Seen only"
touch = false

[[condition]]
name = "felt"
title = "Seen and felt"

[[target]]
name = "left"
along_mm = -3

[[target]]
name = "right"
along_mm = 3

[[questionnaire]]
file = "sus"
when = "condition"
"""

CALIBRATED = (
    SMALL
    + """
[calibration]
stimuli = 20
presentations = 2
max_rounds = 2
times_threshold = 3.0
"""
)

QUICK = SMALL.replace("repetitions = 2", "repetitions = 1\ntimeout_s = 3").replace(
    "timeout_s = 60", "timeout_s = 2"
)
"""The same with short trials, for simulated participants."""
