"""The loop study: step response and stability margins of control loops."""
