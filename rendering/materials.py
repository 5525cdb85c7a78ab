"""Materials of what is in the picture: Blender's shader nodes, from colours and roughness.

Knows no shapes and no light. Patterns lie in an object's own coordinates [mm].
"""

import bpy

from rendering.scene import Bowl, Color, Needle

__all__ = ["Material", "bowl_material", "mottled", "needle_material", "plain", "wooden"]

COLOR_A, COLOR_B, MIXED = 6, 7, 2  # of a Mix node; sockets of other kinds have the same names
VESSEL_COLOR = (0.35, 0.05, 0.03)
LOWER_BELOW_MM, LOWER_BORDER_MM = -4.0, 2.0  # where the bottom's colour begins, and how much that wavers

Socket = bpy.types.NodeSocket
Material = bpy.types.Material


def plain(name: str, color: Color, roughness: float, *, is_metal: bool = False) -> Material:
    """Return a material of one colour."""
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
    """Return a material whose colour varies from place to place.

    Args:
        name: Its name.
        color: In the mean.
        roughness: Of the surface.
        share: How far the colour goes up and down.
        per_mm: How fine the pattern is.
        stretch: The pattern is so much finer along x, y and z.
    """
    material = plain(name, color, roughness)
    _mottle(material, color, share, per_mm, stretch)
    return material


def wooden(name: str, color: Color) -> Material:
    """Return wood: long grain that can be felt."""
    material = plain(name, color, 0.6)
    noise = _mottle(material, color, 0.12, 0.5, (0.15, 1, 2.2))
    _roughen(material, noise, 0.05)
    return material


def needle_material(needle: Needle) -> Material:
    """Return what a needle is made of: drawn, so that its grain runs along it."""
    material = plain("needle", needle.color, needle.roughness, is_metal=needle.is_metal)
    noise = _mottle(material, needle.color, 0.05, 6, (1, 1, 0.2))
    _roughen(material, noise, 0.03)
    return material


def bowl_material(bowl: Bowl) -> Material:
    """Return what the eye is lined with: mottled, perhaps another colour at the bottom, perhaps vessels."""
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
    """Let the colour vary, and return the noise that it follows."""
    mapping = _node(material, "ShaderNodeMapping", Scale=stretch)
    _link(material, _place(material), mapping.inputs["Vector"])
    noise = _node(material, "ShaderNodeTexNoise", Scale=per_mm, Detail=6)
    _link(material, mapping.outputs["Vector"], noise.inputs["Vector"])
    dark = [max(part * (1 - 2 * share), 0) for part in color]
    bright = [min(part * (1 + 2 * share), 1) for part in color]
    mix = _mix(material, noise.outputs["Fac"])
    mix.inputs[COLOR_A].default_value = (*dark, 1)
    mix.inputs[COLOR_B].default_value = (*bright, 1)
    _link(material, mix.outputs[MIXED], _shader(material).inputs["Base Color"])
    return noise.outputs["Fac"]


def _paint_over(material: Material, is_painted: Socket, color: Color) -> None:
    """Put a colour on where a socket is 1, and leave what is there where it is 0."""
    base = _shader(material).inputs["Base Color"]
    mix = _mix(material, is_painted)
    _link(material, base.links[0].from_socket, mix.inputs[COLOR_A])
    mix.inputs[COLOR_B].default_value = (*color, 1)
    _link(material, mix.outputs[MIXED], base)


def _is_low(material: Material, noise: Socket) -> Socket:
    """Return 1 at the bottom, with a border that wavers with the noise."""
    parts = _node(material, "ShaderNodeSeparateXYZ")
    _link(material, _place(material), parts.inputs["Vector"])
    wavering = _node(material, "ShaderNodeMath")
    wavering.operation = "MULTIPLY_ADD"
    _link(material, noise, wavering.inputs[0])
    wavering.inputs[1].default_value = LOWER_BORDER_MM
    _link(material, parts.outputs["Z"], wavering.inputs[2])
    return _compared(material, wavering.outputs[0], "LESS_THAN", LOWER_BELOW_MM)


def _is_vessel(material: Material) -> Socket:
    """Return 1 along thin winding lines."""
    wave = _node(material, "ShaderNodeTexWave", Scale=0.12, Distortion=14, Detail=2)
    _link(material, _place(material), wave.inputs["Vector"])
    return _compared(material, wave.outputs["Fac"], "GREATER_THAN", 0.985)


def _roughen(material: Material, height: Socket, strength: float) -> None:
    """Make the surface uneven."""
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
    """Return a node that goes from one colour to another."""
    mix = _node(material, "ShaderNodeMix")
    mix.data_type = "RGBA"
    _link(material, factor, mix.inputs[0])
    return mix


def _place(material: Material) -> Socket:
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
