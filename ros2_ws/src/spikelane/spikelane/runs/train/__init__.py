"""A training: a controller learns by driving."""
