"""Device profiles: what a person feels of a device, and the drive that makes patterns feel as meant."""
