"""The web server, access control, and what all pages share."""
