"""Commands of rigs: the camera's lens, and whether a rig is set up as a run relies on."""
