"""Layout -> where screws come up through the base (x, z) [mm], by part; base and parts both ask here."""

from rig.layout import FLOOR_MM, MOUNT_MM, Layout

__all__ = ["POST_MM", "RIB_MM", "WALL_FOOT_MM", "feet_of", "mask_middle_mm", "mirror_wall_mm"]

RIB_MM = 35.0
"""Length of the frame's rib behind its plate."""
FRAME_FOOT_MM = 14.0
WALL_FOOT_MM = 7.0
POST_MM = (53.0, 44.0)
"""Of the mask's posts from the middle of the mask, in x and z."""


def feet_of(layout: Layout) -> dict[str, list[tuple[float, float]]]:
    """Return the screws of every part that stands on the base."""
    plate_z = layout.back_mm - FLOOR_MM / 2
    feet = {
        "frame": [
            (-FRAME_FOOT_MM, plate_z),
            (FRAME_FOOT_MM, plate_z),
            (0.0, layout.back_mm - FLOOR_MM - RIB_MM + 8),
        ],
        "camera_mount": _camera_feet(layout),
        "light": [(side * layout.leg_mm, layout.rig.light.from_section_mm) for side in (-1, 1)],
    }
    if layout.mirror:
        low, high = mirror_wall_mm(layout)
        x_mm = layout.wall_mm + FLOOR_MM / 2
        feet["mirror_mount"] = [
            (x, z) for x in (-x_mm, x_mm) for z in (low + WALL_FOOT_MM, high - WALL_FOOT_MM)
        ]
        middle, (aside, along) = mask_middle_mm(layout), POST_MM
        feet["post"] = [(x, middle + z) for x in (-aside, aside) for z in (-along, along)]
    return feet


def mirror_wall_mm(layout: Layout) -> tuple[float, float]:
    """Return between which z the mirror mount's walls stand on the base."""
    middle, half = layout.mirror_center_mm[2], layout.rig.mirrors[0].size_mm[1] / 2 * 0.7071
    return float(middle - half + 2), float(middle + half - 4)


def mask_middle_mm(layout: Layout) -> float:
    """Return z of the middle of the mask: the nose is above the mirror."""
    return float(layout.mirror_center_mm[2])


def _camera_feet(layout: Layout) -> list[tuple[float, float]]:
    width, height, _ = layout.rig.camera.body_mm
    right, up = width / 2 + MOUNT_MM - 4.5, height / 2 + MOUNT_MM - 4.5
    if not layout.mirror:
        z_mm = layout.camera.front_mm[2] + layout.depth_mm + FLOOR_MM / 2
        x_mm = layout.camera.front_mm[0]
        return [(x_mm - right, z_mm), (x_mm + right, z_mm), (x_mm, z_mm - RIB_MM + FLOOR_MM / 2)]
    corners = [layout.camera.at(r, u, 0) for r in (-right, right) for u in (-up, up)]
    return [(float(corner[0]), float(corner[2])) for corner in corners]
