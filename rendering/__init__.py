"""Labelled clips of scenes that Blender's path tracer renders: `make render`. Not part of the package.

Two environments share the work. `render` runs where Blender is (`.venv-rendering`) and turns a scene into raw
images; `pack` runs in `.venv` and turns these into a clip that `haptigraph evaluate` takes. What both need to
know, and all that can be tested without Blender, is in `scene`, `path` and `layout`.
"""
