"""What the tests of worlds share: all that a compiled model is, to compare it with another."""

from typing import Any

import mujoco
import numpy as np


def arrays(model: mujoco.MjModel) -> dict[str, Any]:
    """Every array and number of a model by name, options included; not names and keyframes."""
    skipped = ("_", "name", "key_", "nname", "nkey", "nbuffer", "signature")
    values = {}
    for owner, prefix in ((model, ""), (model.opt, "opt."), (model.stat, "stat.")):
        for name in dir(owner):
            value = getattr(owner, name) if not name.startswith(skipped) else None
            if isinstance(value, np.ndarray | int | float):
                values[prefix + name] = value
    return values
