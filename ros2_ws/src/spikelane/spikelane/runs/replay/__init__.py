"""A replay: a recorded drive goes through a controller once more."""
