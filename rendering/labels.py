"""Labels of a rendered clip: the registration of its eye, and the ground truth of every image.

They come from the geometry and the rules, never from the images.
"""

from collections.abc import Sequence

from haptigraph.analysis.evaluation.ground_truth import TruthRow
from haptigraph.analysis.evaluation.sweep import true_rows
from haptigraph.geometry import Segment
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Truth
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.text import AnatomyPx, TrocarPx, registration_text
from rendering.layout import HEIGHT_PX, WIDTH_PX, Layout
from rendering.path import Pose

__all__ = ["registration_of", "truth_of"]


def registration_of(layout: Layout) -> str:
    """Return the registration of a scene, as TOML."""
    eye = layout.eye
    trocars = tuple(
        TrocarPx(name, layout.to_px(each.trocar_mm), name == layout.scene.trocar)
        for name, each in layout.eyes.items()
    )
    anatomy = AnatomyPx(
        width_px=WIDTH_PX,
        height_px=HEIGHT_PX,
        mirrored=False,
        center_px=layout.image.center_px,
        radius_px=eye.radius_mm / layout.image.mm_per_px,
        diameter_mm=eye.shape.diameter_mm,
        contour_px=tuple(layout.to_px(point_mm) for point_mm in eye.retina_mm),
        target_px=layout.to_px(eye.target_mm),
        trocars=trocars,
    )
    return registration_text(anatomy, "Registration of a rendered eye.")


def truth_of(layout: Layout, poses: Sequence[Pose | None], procedure: Procedure) -> list[TruthRow]:
    """Return the ground truth of every image.

    Args:
        layout: Layout of the scene.
        poses: Poses of the needle; None for images without needle.
        procedure: The procedure whose rules determine the states.
    """
    registration = parse_registration(registration_of(layout), "the scene's registration")
    truths = [_truth(layout, pose) for pose in poses]
    return true_rows(truths, registration, procedure)


def _truth(layout: Layout, pose: Pose | None) -> Truth:
    if pose is None:
        nowhere = (0.0, 0.0)
        return Truth(False, False, nowhere, nowhere, depth_mm=0.0, theta_deg=0.0)
    placed = layout.placed(pose)
    is_visible = layout.is_visible(placed)
    return Truth(
        visible=is_visible,
        inside=layout.is_inside(placed),
        tip_px=layout.to_px(placed.tip_mm, placed.behind_mm),
        tip_mm=placed.tip_mm,
        depth_mm=pose.depth_mm,
        theta_deg=abs(pose.theta_deg),
        others={"needle_line": Segment(layout.eye.trocar_mm, placed.axis_mm)} if is_visible else {},
    )
