"""Robots in scenes of others: attached to a MuJoCo specification, and driven by their firmware."""
