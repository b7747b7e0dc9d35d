"""An evaluation: laps of every lane with several seeds, measured on the whole."""
