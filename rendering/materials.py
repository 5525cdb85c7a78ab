"""Materials as Blender shader nodes. Patterns are in object coordinates [mm]."""

import bpy

from rendering.scene import Bowl, Color, Needle

__all__ = ["Material", "bowl_material", "mottled", "needle_material", "plain", "wooden"]

COLOR_A, COLOR_B, MIXED = 6, 7, 2  # sockets of a Mix node; names are ambiguous
VESSEL_COLOR = (0.35, 0.05, 0.03)
LOWER_BELOW_MM, LOWER_BORDER_MM = -4.0, 2.0  # height of the bottom colour's border, and its irregularity

Socket = bpy.types.NodeSocket
Material = bpy.types.Material


def plain(name: str, color: Color, roughness: float, *, is_metal: bool = False) -> Material:
    """Return a material of uniform colour."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    inputs = _shader(material).inputs
    inputs["Base Color"].default_value = (*color, 1)
    inputs["Roughness"].default_value = roughness
    inputs["Metallic"].default_value = float(is_metal)
    return material


def mottled(
    name: str,
    color: Color,
    roughness: float,
    *,
    share: float,
    per_mm: float,
    stretch: tuple[float, float, float] = (1, 1, 1),
) -> Material:
    """Return a material of mottled colour.

    Args:
        name: Its name.
        color: Mean colour.
        roughness: Surface roughness.
        share: Relative variation of the colour.
        per_mm: Spatial frequency of the pattern.
        stretch: Scale of that frequency along x, y and z.
    """
    material = plain(name, color, roughness)
    _mottle(material, color, share, per_mm, stretch)
    return material


def wooden(name: str, color: Color) -> Material:
    """Return wood, with grain in colour and relief."""
    material = plain(name, color, 0.6)
    noise = _mottle(material, color, 0.12, 0.5, (0.15, 1, 2.2))
    _roughen(material, noise, 0.05)
    return material


def needle_material(needle: Needle) -> Material:
    """Return a needle's material, with grain along the shaft."""
    material = plain("needle", needle.color, needle.roughness, is_metal=needle.is_metal)
    noise = _mottle(material, needle.color, 0.05, 6, (1, 1, 0.2))
    _roughen(material, noise, 0.03)
    return material


def bowl_material(bowl: Bowl) -> Material:
    """Return the lining of the eye: mottled, optionally with another colour at the bottom, and vessels."""
    material = plain("bowl", bowl.color, 0.7)
    noise = _mottle(material, bowl.color, bowl.mottle, 1.2, (0.4, 0.4, 2.0))
    if bowl.lower_color:
        _paint_over(material, _is_low(material, noise), bowl.lower_color)
    if bowl.vessels:
        _paint_over(material, _is_vessel(material), VESSEL_COLOR)
    return material


def _mottle(
    material: Material, color: Color, share: float, per_mm: float, stretch: tuple[float, float, float]
) -> Socket:
    """Modulate the colour by noise, and return the noise."""
    mapping = _node(material, "ShaderNodeMapping", Scale=stretch)
    _link(material, _coordinates(material), mapping.inputs["Vector"])
    noise = _node(material, "ShaderNodeTexNoise", Scale=per_mm, Detail=6)
    _link(material, mapping.outputs["Vector"], noise.inputs["Vector"])
    dark = [max(part * (1 - 2 * share), 0) for part in color]
    bright = [min(part * (1 + 2 * share), 1) for part in color]
    mix = _mix(material, noise.outputs["Fac"])
    mix.inputs[COLOR_A].default_value = (*dark, 1)
    mix.inputs[COLOR_B].default_value = (*bright, 1)
    _link(material, mix.outputs[MIXED], _shader(material).inputs["Base Color"])
    return noise.outputs["Fac"]


def _paint_over(material: Material, mask: Socket, color: Color) -> None:
    """Blend in a colour where the mask is 1."""
    base = _shader(material).inputs["Base Color"]
    mix = _mix(material, mask)
    _link(material, base.links[0].from_socket, mix.inputs[COLOR_A])
    mix.inputs[COLOR_B].default_value = (*color, 1)
    _link(material, mix.outputs[MIXED], base)


def _is_low(material: Material, noise: Socket) -> Socket:
    """Return a mask of the bottom, with a border that varies with the noise."""
    axes = _node(material, "ShaderNodeSeparateXYZ")
    _link(material, _coordinates(material), axes.inputs["Vector"])
    height = _node(material, "ShaderNodeMath")
    height.operation = "MULTIPLY_ADD"
    _link(material, noise, height.inputs[0])
    height.inputs[1].default_value = LOWER_BORDER_MM
    _link(material, axes.outputs["Z"], height.inputs[2])
    return _compared(material, height.outputs[0], "LESS_THAN", LOWER_BELOW_MM)


def _is_vessel(material: Material) -> Socket:
    """Return a mask of thin winding lines."""
    wave = _node(material, "ShaderNodeTexWave", Scale=0.12, Distortion=14, Detail=2)
    _link(material, _coordinates(material), wave.inputs["Vector"])
    return _compared(material, wave.outputs["Fac"], "GREATER_THAN", 0.985)


def _roughen(material: Material, height: Socket, strength: float) -> None:
    """Add a bump map."""
    bump = _node(material, "ShaderNodeBump", Strength=strength)
    _link(material, height, bump.inputs["Height"])
    _link(material, bump.outputs["Normal"], _shader(material).inputs["Normal"])


def _compared(material: Material, value: Socket, operation: str, limit: float) -> Socket:
    node = _node(material, "ShaderNodeMath")
    node.operation = operation
    _link(material, value, node.inputs[0])
    node.inputs[1].default_value = limit
    return node.outputs[0]


def _mix(material: Material, factor: Socket) -> bpy.types.Node:
    """Return a node that blends two colours."""
    mix = _node(material, "ShaderNodeMix")
    mix.data_type = "RGBA"
    _link(material, factor, mix.inputs[0])
    return mix


def _coordinates(material: Material) -> Socket:
    return _node(material, "ShaderNodeTexCoord").outputs["Object"]


def _shader(material: Material) -> bpy.types.Node:
    return material.node_tree.nodes["Principled BSDF"]


def _node(material: Material, kind: str, **inputs: float | tuple[float, ...]) -> bpy.types.Node:
    node = material.node_tree.nodes.new(kind)
    for name, value in inputs.items():
        node.inputs[name].default_value = value
    return node


def _link(material: Material, output: Socket, into: Socket) -> None:
    material.node_tree.links.new(output, into)
