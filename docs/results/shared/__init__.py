"""What several scripts of results share; each is run as docs/results/NAME.py."""
