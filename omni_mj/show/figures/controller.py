"""The fuzzy controller itself: its sets (figures 5 and 6) and its surface."""

from dataclasses import astuple
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator

from omni_control.fuzzy import rules as fuzzy
from omni_mj.scenarios.settings import ControlSettings
from omni_mj.show import style
from omni_mj.show.figures import canvas

DASHES = ("-", "--", "-.", ":")


def memberships(control: ControlSettings) -> Figure:
    """Five sets of each input (figure 5) and of each output (figure 6), labelled at their peaks."""
    figure, ((inputs, outputs),) = canvas.panels(1, 2, 3.35, 1.9, gap=(0.4, 0.0), above=0.45)
    figure.suptitle("Membership functions of the fuzzy controller")
    e_x, v_x = fuzzy.ENGINE.inputs[0], fuzzy.ENGINE.outputs[0]
    sides = (
        (e_x, "Inputs, of x and y (the paper's figure 5)", "position error in cm", 100 * control.error_range_m),
        (v_x, "Outputs, of x and y (the paper's figure 6)", "velocity in m/s", control.speed_range_m_s),
    )
    for axes, (variable, title, label, reach) in zip((inputs, outputs), sides, strict=True):
        for k, (name, corners) in enumerate(variable.sets.items()):
            x, y = reach * np.array(astuple(corners)), [0, 1, 1, 0]
            axes.plot(x, y, color=style.colour(k), lw=1.6, ls=DASHES[k % 2])
            axes.fill(x, y, color=style.colour(k), alpha=0.1, lw=0)
            peak = np.clip(x[1:3].mean(), reach * variable.low, reach * variable.high)
            axes.annotate(name, (peak, 1), (0, 4), textcoords="offset points", ha="center", weight="bold",
                          annotation_clip=False)  # fmt: skip
        axes.set(xlabel=label, xlim=(reach * variable.low, reach * variable.high), ylim=(0, 1.02))
        axes.set_title(title, pad=18)
        axes.yaxis.set_major_locator(MultipleLocator(0.5))
        axes.xaxis.set_major_formatter("{x:g}")
    inputs.set_ylabel("degree of membership")
    outputs.tick_params(labelleft=False)
    return figure


def surface(control: ControlSettings) -> Figure:
    """The output v_x over both errors, and sections through it."""
    flc = fuzzy.FuzzyLaw(control.error_range_m, control.speed_range_m_s)
    reach = control.error_range_m
    figure = canvas.sheet(8.0, 3.4)
    figure.suptitle("Control surface of the fuzzy controller")
    solid: Any = figure.add_axes((0.01, 0.0, 0.5, 1.0), projection="3d")
    e = np.linspace(-reach, reach, 33)  # a multiple of the sets' spacing, so that edges lie on the grid
    ex, ey = np.meshgrid(e, e)
    vx = flc(np.stack([ex, ey], axis=-1))[..., 0]
    solid.plot_surface(100 * ex, 100 * ey, vx, cmap="cividis", rcount=33, ccount=33, lw=0.2, edgecolor="#FFFFFF80")
    solid.zaxis.set_major_locator(MaxNLocator(5))
    solid.set(xlabel="error in x, cm", ylabel="error in y, cm", zlabel="velocity in x, m/s")
    solid.view_init(elev=25, azim=-120)
    for axis in (solid.xaxis, solid.yaxis):
        axis.set_ticks(100 * reach * np.linspace(-1, 1, 5))
    solid.set_box_aspect((1, 1, 0.75), zoom=0.95)

    section = figure.add_axes((0.6, 0.16, 0.37, 0.75))
    fine = np.linspace(-reach, reach, 801)
    for dashes, share in zip(DASHES, (0, 0.125, 0.25), strict=False):
        v = flc(np.stack([fine, np.full_like(fine, share * reach)], axis=-1))[..., 0]
        section.plot(100 * fine, v, color=style.colour(DASHES.index(dashes)), ls=dashes, lw=1.5,
                     label=f"error in y: {100 * share * reach:g} cm")  # fmt: skip
    section.xaxis.set_major_locator(MaxNLocator(5, steps=canvas.STEPS))
    section.yaxis.set_major_locator(MaxNLocator(5, steps=canvas.STEPS))
    section.set(xlabel="error in x, cm", ylabel="velocity in x, m/s", title="Sections")
    section.axhline(0, color="#888888", lw=0.8)
    section.axvline(0, color="#888888", lw=0.8)
    section.legend(loc="upper left")
    return figure
