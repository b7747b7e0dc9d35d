"""Many robots in one kernel, each as it would be alone; see `kernel`."""
