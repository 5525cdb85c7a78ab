"""The needle tracker, one stage a module; `tracker` calls them in order."""
