"""Training of the network of the perceiver `segmentation`: `make train`. Not part of the package."""
