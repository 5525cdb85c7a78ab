"""Labelled clips of scenes rendered with Blender's path tracer: `make render`. Not part of the package.

`render` runs in the environment with Blender (`.venv-rendering`) and turns a scene into raw images. `pack`
runs in `.venv` and turns these into a clip for `haptigraph evaluate`. `scene`, `path` and `layout` need no
Blender and serve both.
"""
