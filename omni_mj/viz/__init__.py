"""Figures of runs, recordings for the rerun viewer, and films."""
