"""MuJoCo models: robots from their settings or a user's MJCF, and the world that contains them."""
