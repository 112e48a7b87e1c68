"""Figure of the fuzzy controller's membership functions."""

import numpy as np
from matplotlib.figure import Figure

from omni_control.fuzzy import LABELS, PEAKS, memberships
from omni_mj.scenarios.settings import ControlSettings
from omni_mj.show import style


def draw_memberships(control: ControlSettings, figure: Figure) -> None:
    """Draw the five sets of each input (figure 5) and of each output (figure 6), named at their peaks."""
    figure.subplots_adjust(0.08, 0.17, 0.98, wspace=0.15)
    figure.set_size_inches(8, 3)
    inputs, outputs = figure.subplots(1, 2, sharey=True)
    inputs.set(title="Inputs, of x and y (the paper's figure 5)", xlabel="position error in cm")
    outputs.set(title="Outputs, of x and y (the paper's figure 6)", xlabel="velocity in m/s")
    inputs.set_ylabel("degree of membership")
    scales = (100 * control.error_range_m, control.speed_range_m_s)
    values = np.linspace(-1, 1, 41)
    for axes, scale in zip((inputs, outputs), scales, strict=True):
        sets = zip(LABELS, scale * PEAKS.ravel(), memberships(values[None])[:, 0], strict=True)
        for k, (name, peak, degrees) in enumerate(sets):
            axes.plot(scale * values, degrees, color=style.colour(k), lw=1.6, ls="--" if k % 2 else "-")
            axes.fill_between(scale * values, degrees, color=style.colour(k), alpha=0.1, lw=0)
            axes.text(peak, 1.02, name, ha="center", weight="bold")
        axes.set(xlim=(-scale, scale), ylim=(0, 1.12), yticks=[0, 0.5, 1])
    figure.suptitle("Membership functions of the fuzzy controller")
