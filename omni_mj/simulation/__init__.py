"""The simulation loop, the construction of the team, and the log."""
