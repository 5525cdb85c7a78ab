"""Calibrate a camera: the ChArUco sheet, its corners in pictures, the lens and its uncertainty."""
