"""The paper's fuzzy controller in scikit-fuzzy: the reference of tests."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from skfuzzy.control import ControlSystemSimulation

LABELS = ("NB", "NS", "ZO", "PS", "PB")

# Tables 1 and 2 with the labels of the example below them: rows e_y, columns e_x, from NB to PB.
TABLE_1 = ["NB NS ZO PS PB"] * 5
TABLE_2 = ["NB NB NB NB NB", "NS NS NS NS NS", "ZO ZO ZO ZO ZO", "PS PS PS PS PS", "PB PB PB PB PB"]


def triangles(universe: np.ndarray) -> np.ndarray:
    """The five sets of figures 5 and 6 over the range [-1, 1], (5, points)."""
    import skfuzzy  # here, since each process of the tests imports this file

    corners = [(-1, -1, -0.5), (-1, -0.5, 0), (-0.5, 0, 0.5), (0, 0.5, 1), (0.5, 1, 1)]
    return np.array([skfuzzy.trimf(universe, abc) for abc in corners])


def controller(
    points: int, error_range_m: float, speed_range_m_s: float
) -> "ControlSystemSimulation":
    """Return the 25 rules, inputs e_x and e_y, outputs v_x and v_y, on universes of `points`."""
    from skfuzzy import control

    relative = np.linspace(-1, 1, points)
    e_x, e_y = (control.Antecedent(error_range_m * relative, name) for name in ("e_x", "e_y"))
    v_x, v_y = (control.Consequent(speed_range_m_s * relative, name) for name in ("v_x", "v_y"))
    for variable in (e_x, e_y, v_x, v_y):
        for label, degrees in zip(LABELS, triangles(relative), strict=True):
            variable[label] = degrees
    rules = [
        control.Rule(e_x[column] & e_y[row], (v_x[first], v_y[second]))
        for row, line_1, line_2 in zip(LABELS, TABLE_1, TABLE_2, strict=True)
        for column, first, second in zip(LABELS, line_1.split(), line_2.split(), strict=True)
    ]
    return control.ControlSystemSimulation(control.ControlSystem(rules))


def velocities(simulation: "ControlSystemSimulation", errors: np.ndarray) -> np.ndarray:
    """Outputs (n, 2) for errors (n, 2)."""
    simulation.inputs({"e_x": errors[:, 0], "e_y": errors[:, 1]})
    simulation.compute()
    return np.stack([simulation.output["v_x"], simulation.output["v_y"]], axis=-1)
