"""Runs: what determines one, the folder it leaves, and a package for each kind."""
