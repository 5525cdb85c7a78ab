"""Pictures of a rig as built, by Blender's path tracer, through a mirror and a camera that are bodies in it.

`make rig-registration` registers them and compares with the prediction: `benchmarks/rig_registration.py`.
"""
