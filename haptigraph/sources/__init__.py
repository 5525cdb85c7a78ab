"""Where images come from: camera, video, folder of images, recording, simulated phantom."""
