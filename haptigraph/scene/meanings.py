"""What each measure says, in words: for data dictionaries and the metadata of exports."""

from haptigraph.graph import Schema

__all__ = ["MEANINGS", "meaning_of", "meanings_in"]

DISTANCE = "distance_mm"
MEANINGS = {
    DISTANCE: "distance, negative beyond a surface as seen from the trocar",
    "radial_mm": "distance of the tip from the line trocar -> target",
    "tip_disagreement_mm": "distance between two observations of one tip",
    "theta_deg": "angle between the shaft and the line trocar -> target, in the image",
    "wall_mm": "distance to the globe's wall, positive inside",
    "clearance_mm": "shortest distance between two shafts' centre lines; 0 if they cross in the image",
    "aside_mm": "distance beside a region of the retina; at most 0 above it",
    "gap_um": "distance to a layer in OCT, positive above it, negative below",
    "incidence_deg": "angle between the shaft and the surface at its tip: 0 parallel, 90 perpendicular",
    "depth_percent": "depth along the beam between a surface (0) and the RPE (100)",
    "thickness_um": "distance along the beam between two surfaces, below the tip",
    "out_of_plane_um": "distance of the tip from the middle section of a volume",
    "out_of_plane_mm": "distance of the shaft's tip from the section, on either side",
    "out_of_plane_deg": "angle between the shaft and the section, towards either side",
    "theta_space_deg": "angle in space between the shaft and the line trocar -> target",
    "elapsed_s": "time since the phase began",
}
"""By the names of `scene.relations.MEASURES`."""


def meanings_in(schema: Schema) -> dict[str, str]:
    """Return what each measure of a procedure means, and between which entities, by its name in graphs."""
    meanings: dict[str, str] = {}
    for one in schema.relations:
        text = f"{MEANINGS.get(one.measure, one.measure)} ({one.subject}, {one.object})"
        meanings.setdefault(schema.measure_name(one), text)
    return meanings


def meaning_of(name: str) -> str:
    """Return what a measure of any procedure means, by its name in graphs."""
    if name.startswith("distance_to_"):
        return MEANINGS[DISTANCE]
    return MEANINGS.get(name, "named by its procedure: the measure of the relations with this alias")
