"""Sources of images: cameras, videos, folders, OCT files, recordings, the simulated phantom."""
