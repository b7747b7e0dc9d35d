"""What changes of a simulation: from episode to episode (randomisation), and while driving.

Both are parameters of the simulator that become others. `schedule.py` says which hold when.
"""
