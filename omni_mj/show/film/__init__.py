"""Films of runs: the robots' own models where the trajectory says they were, drawn by MuJoCo without a display."""
