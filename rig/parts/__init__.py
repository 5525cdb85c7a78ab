"""One module a part: Layout -> solid, where it is in the assembled rig."""
