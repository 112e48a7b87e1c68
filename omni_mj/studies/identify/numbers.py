"""What parameters of the law mean: the numbers of a robot that follow from them, with errors by the delta method."""

from collections.abc import Callable

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import Settings
from omni_mj.studies.identify import law
from omni_mj.studies.identify.fit import LATE, RANGES, Fit

STEP = 0.05  # of numeric gradients, over the sizes of `RANGES`


def of(body: law.Body, settings: Settings, parameters: Array, wheels: bool) -> dict[str, float]:
    """Numbers of a robot whose motion follows the law with parameters.

    K and T are those of TIGERs' law v' = (K u - v) / (T |u|) for small accelerations (`omni_mj.studies.slip.law`): with
    T0 = 1 / (C sum n_i d_i^2) of loads n_i per mass, and the drag's deceleration D, K = scale / (1 + T0 D) and
    T = K^2 T0 / scale.

    Args:
        body: that was fitted.
        settings: of the start robot.
        parameters: as `law.simulate` has them.
        wheels: whether inputs were speeds of wheels, else commands.
    """
    p = dict(zip(law.NAMES, map(float, parameters[: len(law.NAMES)]), strict=True))
    scale, give, loads = p["scale"], p["give_s"], body.rest
    found = {}
    axles = np.abs(np.stack([body.outward.real, body.outward.imag]))
    for axis, name in enumerate(("forward", "sideways")):
        directions = body.wheels[:, axis]
        squares = float((directions**2).sum())
        time = p["creep"] / float((loads * directions**2).sum())
        drag = p["pile"] * float(loads.sum()) + p["roller_friction"] * float((loads * axles[axis]).sum())
        gain = scale / (1 + time * drag)
        found[f"gain_{name}"], found[f"creep_{name}_s2_m"] = gain, gain**2 * time / scale
        found[f"drag_{name}_m_s2"] = drag
        if not wheels:
            found[f"lag_{name}_s"] = give * (1 / squares + body.hub)
            rubbed = p["friction_m_s"] * float(np.abs(directions).sum()) / squares + give * drag / squares
            found[f"friction_{name}_m_s"] = rubbed
    inertia = float(body.mass[2, 2])
    arm = body.arm * p["arm"]
    time = p["creep"] * inertia / float((loads * arm**2).sum())
    slowed = 1 + time * arm * p["pile"] * float(loads.sum()) * arm / inertia
    if wheels:
        found["gain_turning"] = scale / p["arm"] / slowed
        found |= {"radius_m": body.radius * scale, "arm_m": arm}
    else:
        loop = 1 + p["turn_gain"]
        found["gain_turning"] = scale * loop / (slowed + scale * p["turn_gain"])
        squares = len(loads) * arm**2
        found["lag_turning_s"] = give * (inertia / squares + body.hub) / (1 + scale * p["turn_gain"])
        found["stiffness_n_s_m"] = settings.body.mass_kg / max(give, 1e-9)
        found["integral_1_s"] = p["integral_1_s"]
    if p["creep"] > 0:
        found["creep_stiffness"] = 1 / p["creep"]
    return (
        found
        | {name: p[name] for name in ("pile", "roller_friction", "compass_rad", "grip", "drift")}
        | {f"slope_{axis}_rad": p[f"lean_{axis}_m_s2"] / law.GRAVITY_M_S2 for axis in "xy"}
    )


def with_errors(fitted: Fit, number: Callable[[Array], dict[str, float]]) -> dict[str, tuple[float, float]]:
    """Numbers and their standard errors; infinite where they depend on what the data do not show."""
    value = number(fitted.parameters)
    gradient = {name: np.zeros(len(fitted.names)) for name in value}
    for i, name in enumerate(fitted.names):
        if name == LATE:
            continue
        at, step = fitted.parameters.copy(), STEP * RANGES[name][0]
        at[law.NAMES.index(name)] += step
        moved = number(at)
        for key in value:
            gradient[key][i] = (moved.get(key, value[key]) - value[key]) / step
    unknown = ~np.isfinite(np.diag(fitted.covariance))
    finite = np.where(np.isfinite(fitted.covariance), fitted.covariance, 0.0)
    errors = {}
    for key, slope in gradient.items():
        error = float(max(float(slope @ finite @ slope), 0.0) ** 0.5)
        errors[key] = float("inf") if np.abs(slope[unknown]).max(initial=0.0) > 1e-9 else error
    return {key: (value[key], errors[key]) for key in value}
