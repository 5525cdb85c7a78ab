"""How the network of the perceiver `segmentation` is made: `make train`. Not part of the package."""
