"""What each perceiver reports, by its name: known without importing the perceiver."""

__all__ = ["ENTITIES", "NEEDLE_3D", "ROBOT_TIP"]

NEEDLE_3D = "needle_3d"
"""The shaft in space, from the trocar to the tip: of a run with depth images, whatever its perceiver."""

ROBOT_TIP = "robot_tip"
"""The tip as the robot reports it: of a run that reads a calibrated robot, whatever its perceiver."""
NEEDLE = frozenset(("needle_tip", "needle_line"))
SCAN = NEEDLE | {"ilm", "rpe", "target_layer", "subretinal_space"}
FORCEPS = frozenset(
    (
        *("forceps_tip", "forceps_line", "forceps_jaws", "left_jaw", "right_jaw"),
        *("light_pipe_tip", "light_pipe_line", "membrane_edge", "hemorrhage"),
    )
)
ENTITIES = {
    "tracker": NEEDLE,
    "threshold": NEEDLE,
    "bscan": SCAN,
    "segmentation": SCAN,
    "volume": SCAN | {"needle_tip_ahead", "needle_bevel"},
    "forceps": FORCEPS,
}
"""Besides the registered anatomy; and besides `retina_surface`, which perceivers of B-scans report too."""
