"""Robots of the planar plant sway on a carpet that is as stiff under a wheel as rollers stand there."""

import numpy as np
import pytest
from default_robot import MASS_KG, RADIUS_M, ROLLER_RADIUS_M, ROLLERS
from driving import drive, quiet, ramp, rows
from numpy.typing import NDArray
from omni_mj.plants.planar.plant import PlanarPlant
from scipy.optimize import brentq

from omni_mj.plants.planar import cycle, laws
from omni_mj.worlds.contact import ADDED_MASS_KG, STIFFNESS_N_M, damping

PITCH = 2 * np.pi / ROLLERS


def waves() -> float:
    """How high the waves of `laws.passing` are in their first harmonic."""
    turn = np.arange(1000) / 1000
    return float(2 * np.mean(laws.passing(turn) * np.cos(2 * np.pi * turn)))


def test_the_carpet_is_as_stiff_as_rollers_stand_on_it() -> None:
    """Rollers are counted while a wheel turns by one of them; of their number the mean and first harmonic are taken."""
    r = PlanarPlant(rows([quiet()]), np.zeros((1, 3)))._robots
    phi = np.linspace(-1, 1, 20001) * PITCH  # beyond which no roller reaches the carpet
    around = np.linspace(-np.pi / 2, np.pi / 2, 4001)[:, None]
    half = np.sqrt(RADIUS_M * ROLLER_RADIUS_M)
    out, up = RADIUS_M - ROLLER_RADIUS_M + ROLLER_RADIUS_M * np.cos(around), half * np.sin(around)
    reach = np.concatenate([(out * np.cos(some) + up * np.sin(some)).max(0) for some in np.array_split(phi, 20)])
    share = (phi[1] - phi[0]) / PITCH
    for wheel, load in enumerate(r.weight[:, 0]):

        def carried(height: float, load: float = load) -> float:
            return share * float(np.maximum(STIFFNESS_N_M * (reach - height), 0).sum()) - load

        stands = reach > brentq(carried, RADIUS_M - 3e-4, RADIUS_M)
        count, first = share * stands.sum(), 2 * share * (stands * np.cos(ROLLERS * phi)).sum()
        # 1 %: counts are interpolated between loads, and a roller more or less is a part in 200 of those that stand.
        np.testing.assert_allclose(r.stiffens[wheel, 0] * waves(), first / count, rtol=0.01)


@pytest.mark.parametrize("stiffens", [False, True])
def test_wheels_press_by_springs_dampers_and_masses_of_the_rollers_that_stand(stiffens: bool) -> None:
    """f = n (K u + c u' + m u'') under each wheel, solved at once for heave and both tilts of robots on their ways."""
    n, chosen = 60, quiet(physics={"kernel": "numpy"})
    plant = PlanarPlant(rows([chosen] * n), np.zeros((n, 3)))
    drive(plant, ramp(np.random.default_rng(0).uniform(-1, 1, (n, 3)) * [1.5, 1.5, 4], 2.0, 50))
    r, m, rims = plant._robots, plant._motion, plant._traction.arrays().rims
    if not stiffens:
        r.stiffens[:] = 0
    sway, rate, tilt = (each.copy() for each in (m.sway, m.sway_rate, m.tilt))
    cycle.move(r, m, rims.rim_friction, rims.softness, np.zeros_like(m.speed))
    wave = laws.passing(m.turns)
    pulled = np.concatenate([np.zeros((1, n)), m.tilt - tilt])
    each = r.spring[0] * MASS_KG / (STIFFNESS_N_M - r.spring[0] * ADDED_MASS_KG) / 4  # n, of k = n K / (M / 4 + n m)

    def loads(share: NDArray) -> NDArray:
        found: list[NDArray] = []
        for i in range(n):
            plane = np.stack([np.ones(4), *r.contacts[:, :, i]])  # heights of wheels for heave and tilts
            square = plane @ plane.T
            u, v = (np.linalg.solve((MASS_KG / 4 + each * ADDED_MASS_KG) * square, of[:, i]) for of in (sway, rate))
            count, ripple = each * (1 + (share * wave)[:, i]), (m.ripple * wave)[:, i]
            springs = count * (plane.T @ (STIFFNESS_N_M * u + damping(MASS_KG / 4) * v))
            body = MASS_KG / 4 * square + ADDED_MASS_KG * (plane * count) @ plane.T
            yields = np.linalg.solve(body, plane @ (ripple - springs) + pulled[:, i])
            found.append(m.standing[:, i] + ripple - springs - ADDED_MASS_KG * count * (plane.T @ yields))
        return np.array(found).T

    missing, matters = m.load - loads(r.stiffens), loads(r.stiffens) - loads(np.zeros_like(wave))
    # A quarter: what yields on springs that ripple is solved by one step of an iteration, which goes on by such shares.
    assert matters.std() > 0.1 if stiffens else not matters.any()
    assert np.abs(missing).max() < 1e-12 or missing.std() < 0.3 * matters.std()
