"""Registrations: where the static anatomy is in the image. File format, checks, camera and OCT kinds."""
