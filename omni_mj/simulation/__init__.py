"""Simulations: the loop, the teams' computers in it, and what it records."""
