"""Small simulated volumes: a hollow bevelled needle in speckle, without tissue, and their files."""

import numpy as np

from haptigraph.perception.instrument.rotations import rotation_matrix

SHAPE = (240, 32, 36)
VOXEL_MM = (0.008, 0.07, 0.055)
RADIUS_MM = 0.24
BEVEL_DEG = 35.0
WALL_MM = 0.06
AXIS = np.array([0.75, -0.25, 0.61]) / np.linalg.norm([0.75, -0.25, 0.61])
REFLECTION = slice(20, 23)


def grid_mm(shape=SHAPE, voxel_mm=VOXEL_MM):
    """Return the places of all voxels in the eye frame, (rows, slices, columns, 3)."""
    rows, slices, columns = (
        (np.arange(size) - (size - 1) / 2) * step for size, step in zip(shape, voxel_mm, strict=True)
    )
    y, z, x = np.meshgrid(-rows, slices, columns, indexing="ij")
    return np.stack([x, y, z], axis=-1)


def needle_volume(rng, rotation, tip_mm, places=None):
    """Return a volume of a needle whose tip and orientation are given in the eye frame."""
    places = grid_mm() if places is None else places
    local = (places - tip_mm) @ rotation  # the needle's own frame: rotation takes it to the eye frame
    side = np.cross(AXIS, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    centre = local + side * RADIUS_MM  # the tip lies on the surface, the axis below it
    behind = -(centre @ AXIS)
    across = centre - (centre @ AXIS)[..., None] * AXIS
    radius = np.linalg.norm(across, axis=-1)
    height = across @ side
    is_cut = behind < (RADIUS_MM - height) / np.tan(np.deg2rad(BEVEL_DEG))
    wall = np.exp(-(((radius - RADIUS_MM) / WALL_MM) ** 2))
    signal = np.where(is_cut | (behind < 0), 0.0, wall)
    speckle = rng.exponential(size=signal.shape)
    noise = 0.01 * rng.exponential(size=signal.shape)
    grey = 60 * np.log10(1 + 100 * (signal * speckle + noise)) - 15
    grey[REFLECTION] = 180
    return np.clip(grey, 0, 255).astype(np.uint8)


def random_pose(rng):
    """Return a rotation and a tip [mm] that leave the shaft's end outside the volume."""
    tip_mm = np.array([0.4, -0.15, 0.45]) + rng.uniform(-0.15, 0.15, 3)
    return rotation_matrix(np.deg2rad(rng.uniform(-4, 4, 3))), tip_mm


def needle_volumes(rng, count):
    """Return volumes, and their rotations and tips."""
    places = grid_mm()
    poses = [random_pose(rng) for _ in range(count)]
    return [needle_volume(rng, *pose, places) for pose in poses], poses
