"""Estimation of the poses, velocities and parameters of robots from vision and commands."""
