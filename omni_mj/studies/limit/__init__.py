"""The limit study: the smallest error that is possible on a plant, with and without noise.

Without noise, iterative learning finds the limit of actuators and traction (`iterative_learning`).
With noise, LQR tracking of the learned run finds the limit of information (`recorded_run_lqr`).
docs/explanation/results.md discusses both.
"""
