"""The card of a dataset: what a person reads before using or publishing it."""

from collections.abc import Sequence

__all__ = ["card"]


def card(task: str, fps: int, is_simulated: Sequence[bool], *, is_lossless: bool) -> str:
    """Return the card, in Markdown with the header that dataset sites read.

    Args:
        task: The operation.
        fps: Images in a second.
        is_simulated: Of every episode, whether a simulator drew its images.
        is_lossless: Whether every pixel is kept.
    """
    count = sum(is_simulated)
    origin = (
        "All episodes are simulated: a program drew the images."
        if count == len(is_simulated)
        else f"{count} of {len(is_simulated)} episodes are simulated; `meta/haptigraph.json` says which."
    )
    pixels = (
        "The videos are lossless: every pixel is that of the recording. Browsers may not play them."
        if is_lossless
        else "The videos are compressed with loss; statistics in `meta/` are those of the recorded images."
    )
    return f"""---
tags:
- LeRobot
- haptigraph
task_categories:
- robotics
configs:
- config_name: default
  data_files: data/*/*.parquet
---

# {task}

{len(is_simulated)} recordings of an instrument inside an eye, with what haptigraph found in every image:
the instrument, measures, scene graph, surgical state and haptic output. Recorded with research software, not
with a medical device. LeRobot's format v3.0, {fps} images/s.

* {origin}
* {pixels}
* `data_dictionary.csv` has name, type, unit and meaning of every feature. Positions are in the eye frame:
  origin at the globe's centre, x right, y up, z towards the viewer.
* Unknown numbers are NaN, never 0. Statistics leave them out.
* `timestamp` is that of a constant rate, as LeRobot demands. `stamp_ns` is the recorded time.
* What perception reports is an estimate: use its standard deviations, or `truth` where it exists.
* Participants, trials, dates and file names are left out. Nobody has checked whether images identify a
  person, or whether consent covers publication. Add a licence before you publish.
"""
