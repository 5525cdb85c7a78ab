"""The shaft in space, from the depth image of a stereo camera."""
