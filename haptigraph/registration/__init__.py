"""Registrations: where the static anatomy lies in the image. File format, checks, camera and OCT kinds."""
