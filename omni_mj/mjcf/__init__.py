"""Robots in MJCF: where their parts are, what they weigh, and what a user's own file says of them."""
