"""Create, check and correct registrations: what `register` and the registration page do."""
