"""Check the force fields of a procedure: renderable, placeable, and never exerted without a tip."""

from collections.abc import Sequence

from haptigraph.grammar import ForceField
from haptigraph.graph import Schema
from haptigraph.inference.checks import check_name
from haptigraph.messages import TIP_NOT_VISIBLE, UNKNOWN
from haptigraph.toml_document import Document

__all__ = ["TIP", "check_force", "check_forces_of_state"]

TIP = "needle_tip"
"""The entity that a force acts on; without it nothing is exerted."""
ABOVE_0 = {
    "cone": ("stiffness_n_per_mm", "half_angle_deg"),
    "plane": ("stiffness_n_per_mm",),
    "viscous": ("damping_n_s_per_mm",),
}
OPTIONAL = {"cone": ("damping_n_s_per_mm",), "plane": ("damping_n_s_per_mm", "height_mm"), "viscous": ()}
MAX = {"stiffness_n_per_mm": 5.0, "damping_n_s_per_mm": 0.1, "half_angle_deg": 45.0, "height_mm": 25.0}
MAX_LIMIT_N = 10.0
NEEDS = {
    "cone": (TIP, "trocar", "retina_target"),
    "plane": (TIP, "retina_surface"),
    "viscous": (TIP,),
}
"""Entities that place a force field in the eye, by kind."""


def check_force(document: Document, field: ForceField, path: str, schema: Schema) -> None:
    """Raise BadInput if a force field cannot be rendered or placed.

    Args:
        document: The file of the procedure.
        field: The force field.
        path: Its key path in the file.
        schema: Defines the entities that place it.
    """
    required, optional = ABOVE_0[field.kind], OPTIONAL[field.kind]
    for key, most in MAX.items():
        value = getattr(field, key)
        if key not in (*required, *optional) and value != 0:
            raise document.error(f"{field.kind} has no {key}, found {value:g}", f"{path}.{key}")
        if key in required and not 0 < value <= most:
            problem = f"{field.kind} needs {key} above 0 and at most {most:g}, found {value:g}"
            raise document.error(problem, f"{path}.{key}")
        if not 0 <= value <= most:
            raise document.error(f"{key} must be 0 to {most:g}, found {value:g}", f"{path}.{key}")
    if not 0 < field.limit_n <= MAX_LIMIT_N:
        problem = f"limit_n must be above 0 and at most {MAX_LIMIT_N:g}, found {field.limit_n:g}"
        raise document.error(problem, f"{path}.limit_n")
    entities = [entity.name for entity in schema.entities]
    for name in NEEDS[field.kind]:
        if name not in entities:
            raise document.error(f"{field.kind} needs an [[entity]] named {name!r}; add it", f"{path}.kind")


def check_forces_of_state(
    document: Document,
    state: str,
    forces: Sequence[str],
    absent: Sequence[str],
    fields: Sequence[ForceField],
    path: str,
) -> None:
    """Raise BadInput if a state exerts an unknown force, one twice, or any without a tip.

    Args:
        document: The file of the procedure.
        state: Name of the state.
        forces: Names of its force fields.
        absent: Entities whose absence it requires.
        fields: The force fields of the procedure.
        path: Key path of the forces in the file.
    """
    if forces and (state in (UNKNOWN, TIP_NOT_VISIBLE) or TIP in absent):
        raise document.error(f"{state!r} must not exert a force, because no tip is seen; remove force", path)
    if forces and not fields:
        raise document.error(f"force {forces[0]!r} is not defined; add a [[force]] of that name", path)
    for number, name in enumerate(forces):
        check_name(document, "force", name, (field.name for field in fields), path)
        if name in forces[:number]:
            raise document.error(f"force {name!r} is listed twice; keep one of them", path)
