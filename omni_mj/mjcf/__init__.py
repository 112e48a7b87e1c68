"""MuJoCo models: robots from their settings or a user's MJCF, and the world that contains them."""

import os

__all__ = ["mujoco"]

# MUJOCO_GL may name a renderer that this computer does not have. Only films need one.
_environment = dict(os.environ)
try:
    import mujoco
except Exception:  # the type depends on the renderer
    os.environ["MUJOCO_GL"] = "disable"
    import mujoco
finally:  # renderers add variables
    for _name in os.environ.keys() - _environment.keys():
        del os.environ[_name]
    os.environ.update(_environment)
