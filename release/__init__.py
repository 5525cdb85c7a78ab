"""Wheels for every platform from one machine: `make wheels`. Not part of the package."""
