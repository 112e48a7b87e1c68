"""The worlds that robots drive in: a scene and n robots, compiled, and where each robot's parts are in it."""
