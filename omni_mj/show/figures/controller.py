"""Figure of the fuzzy controller's membership functions."""

from dataclasses import astuple

import numpy as np
from matplotlib.figure import Figure

from omni_control.fuzzy import rules as fuzzy
from omni_mj.scenarios.settings import ControlSettings
from omni_mj.show import style


def draw_memberships(control: ControlSettings, figure: Figure) -> None:
    """Draw the five sets of each input (figure 5) and of each output (figure 6), named at their peaks."""
    figure.subplots_adjust(0.08, 0.17, 0.98, wspace=0.15)
    figure.set_size_inches(8, 3)
    inputs, outputs = figure.subplots(1, 2, sharey=True)
    error, velocity = fuzzy.ENGINE.inputs[0], fuzzy.ENGINE.outputs[0]
    inputs.set(title="Inputs, of x and y (the paper's figure 5)", xlabel="position error in cm")
    outputs.set(title="Outputs, of x and y (the paper's figure 6)", xlabel="velocity in m/s")
    inputs.set_ylabel("degree of membership")
    scales = (100 * control.error_range_m, control.speed_range_m_s)
    for axes, variable, scale in zip((inputs, outputs), (error, velocity), scales, strict=True):
        for k, (name, corners) in enumerate(variable.sets.items()):
            x = scale * np.array(astuple(corners))
            axes.plot(x, [0, 1, 1, 0], color=style.colour(k), lw=1.6, ls="--" if k % 2 else "-")
            axes.fill(x, [0, 1, 1, 0], color=style.colour(k), alpha=0.1, lw=0)
            peak = np.clip(x[1:3].mean(), scale * variable.low, scale * variable.high)
            axes.text(peak, 1.02, name, ha="center", weight="bold")
        axes.set(xlim=(scale * variable.low, scale * variable.high), ylim=(0, 1.12), yticks=[0, 0.5, 1])
    figure.suptitle("Membership functions of the fuzzy controller")
