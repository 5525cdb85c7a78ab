"""Automatic registration: find the globe, retina, trocars and camera tilt in images of one set-up."""
