"""The nodes that are measured with."""
