"""The rig as CAD, from a rig.toml: parts, assembly, drawings, bill of materials, checks. See docs/rig.md."""
