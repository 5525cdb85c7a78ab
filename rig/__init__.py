"""The rig as CAD, from a rig.toml: parts, assembly, drawings, lists, checks; docs/how_to/rig.md."""
