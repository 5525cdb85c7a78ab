"""From a few seconds of a source to what is wrong with a rig, and what could not be judged."""

from msgspec import Struct

from haptigraph.analysis.rig_check.clip import Clip
from haptigraph.analysis.rig_check.focus import focus
from haptigraph.analysis.rig_check.glare import glare
from haptigraph.analysis.rig_check.light import light
from haptigraph.analysis.rig_check.orientation import mirroring, uprightness
from haptigraph.analysis.rig_check.position import moved, residuals, whole_eye
from haptigraph.analysis.rig_check.scale import scale
from haptigraph.analysis.rig_check.stability import stability
from haptigraph.analysis.rig_check.subject import Subject
from haptigraph.analysis.rig_check.target import target
from haptigraph.analysis.rig_check.timing import timing
from haptigraph.analysis.rig_check.view import view_of
from haptigraph.findings import Finding
from haptigraph.registration.camera import Registration
from haptigraph.rig.description import Rig

__all__ = ["Judgement", "judge"]


class Judgement(Struct, frozen=True):
    """The result of a check."""

    subjects: tuple[Subject, ...]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All that is wrong."""
        return tuple(finding for subject in self.subjects for finding in subject.findings)

    @property
    def not_judged(self) -> tuple[Subject, ...]:
        """What could not be judged, or not all of it."""
        return tuple(subject for subject in self.subjects if subject.not_judged)


def judge(clip: Clip, registration: Registration, rig: Rig | None = None) -> Judgement:
    """Judge a rig.

    Args:
        clip: A few seconds of its images; best while a needle enters and turns.
        registration: The registration that a run would use.
        rig: The rig as designed, if there is a rig.toml.
    """
    view = view_of(clip, registration)
    return Judgement(
        (
            timing(clip),
            focus(view),
            light(view),
            glare(view),
            stability(view),
            whole_eye(view, rig),
            uprightness(view),
            mirroring(view, rig),
            moved(view),
            residuals(view),
            scale(view, rig),
            target(view, rig),
        )
    )
