"""Automatic registration: find globe, retina, trocars and camera tilt in images of one set-up."""
