"""Backends of the planar plant: equal results but for rounding, gradients, and the choice."""

import copy
import importlib.util
import pickle
import runpy
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benches.plant import drive, planar, ramp, with_settings
from benches.robot import uses_jax

import omni_mj as om
from omni_control.errors import OmniError
from omni_mj.plants.telemetry import TELEMETRY_NAMES

# JAX is imported where it is needed, because each process of the tests imports all files.
pytestmark = pytest.mark.skipif(importlib.util.find_spec("jax") is None, reason="jax is an extra")
EXAMPLE = Path(__file__).parents[2] / "examples" / "gradient" / "find_creep.py"
COMMON: dict[str, Any] = {
    "carpet": {"patches": [[0.3, 0.0, 0.2, 0.3]], "nap": 0.3},
    "randomization": {
        "wheel_friction_std": 0.1, "max_wear_m": 0.0003, "torque_constant_std": 0.03,
        "mass_std": 0.03, "com_offset_std_m": 0.003,
    },
    "disturbance": {"force_n": 5.0},
    "firmware": {"ki": 0.5, "thermal_derating": True, "timeout_s": 0.1},
    "fault": [
        {"kind": "payload", "start_s": 0.1, "mass_kg": 0.5},
        {"kind": "tilt", "start_s": 0.2, "angle_deg": 3.0},
        {"kind": "reboot", "start_s": 0.2, "duration_s": 0.1},
        {"kind": "encoder-scale", "start_s": 0.1, "wheel": 1, "factor": 0.9},
        {"kind": "gyro-scale", "start_s": 0.1, "factor": 0.5},
        {"kind": "wheel-missing-rollers", "start_s": 0.1, "wheel": 2, "rollers": 3},
    ],
}  # fmt: skip


def drive_with(backend: str, robots: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return poses and telemetry of copied robots with pushes, held currents and faults."""
    plant = planar([with_settings(physics={"backend": backend}, **COMMON)] * robots)
    twists = np.linspace(-1, 1, robots)[:, None] * [2.5, 1.0, 3.0] + [0.5, 0.0, 0.0]
    plant.set_motor_currents(np.array([[np.nan, np.nan, np.nan, 0.5]] * robots))
    plant = pickle.loads(pickle.dumps(copy.deepcopy(plant)))
    return drive(plant, ramp(twists, 6.0, 30)), {
        name: getattr(plant.telemetry(), name) for name in TELEMETRY_NAMES
    }


@pytest.mark.parametrize("robots", [1, 20])
def test_compiled_programs_give_the_results_of_numpy(robots: int) -> None:
    """Except for rounding, which grows; for a batch of one, and for one that is padded."""
    poses, telemetry = drive_with("numpy", robots)
    jax_poses, jax_telemetry = drive_with("jax", robots)
    np.testing.assert_allclose(poses, jax_poses, atol=1e-7)
    for name, values in telemetry.items():
        np.testing.assert_allclose(values, jax_telemetry[name], rtol=1e-5, atol=1e-5, err_msg=name)


def test_with_numpy_a_row_has_the_same_bits_in_any_batch() -> None:
    for azimuths in ([60, 135, 225, 300], [20, 65, 110, 155, 200, 245, 290, 335]):
        chosen = with_settings(physics={"backend": "numpy"}, wheels={"azimuths_deg": azimuths})
        several = [chosen.replace(carpet={"friction": friction}) for friction in (0.3, 0.8, 0.5)]
        commands = ramp([[2.0, 1.0, 3.0]] * 3, 4.0, 15)
        together = drive(planar(several), commands)
        for i, settings in enumerate(several):
            np.testing.assert_array_equal(
                drive(planar([settings]), commands[:, :1])[:, 0], together[:, i]
            )


def test_a_gradient_equals_finite_differences() -> None:
    """In the example: the final position of a robot over its creep stiffness."""
    import jax

    example = runpy.run_path(str(EXAMPLE))
    # These compile fast, and run slowly.
    options = {"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False}
    with jax.enable_x64(True):
        drive_robot = partial(example["drive"], *example["make_robot"]())
        value_and_slope = jax.jit(
            lambda stiffness: jax.jvp(drive_robot, (stiffness,), (1.0,)), compiler_options=options
        )
        # Encoders count in steps, which changes the position by up to 0.05 mm.
        stiffness, step = 2.5, 0.1
        _, slope = value_and_slope(stiffness)
        high, low = (float(value_and_slope(stiffness + change)[0]) for change in (step, -step))
    assert float(slope) == pytest.approx((high - low) / (2 * step), rel=0.01)


def test_auto_compiles_long_runs_of_planar_only_and_the_scenario_stores_the_backend() -> None:
    for plant, laps, backend in (
        ("planar", 1, "numpy"),
        ("planar", 300, "jax"),
        ("mujoco", 300, "numpy"),
    ):
        chosen = om.load_scenario("rect", plant=plant, reference={"laps": laps})
        simulation = om.Simulation(chosen, ["flc"], seeds=[0])
        assert simulation.scenario.settings.physics.backend == backend
        assert uses_jax(simulation) == (backend == "jax")


def test_the_backend_jax_is_refused_in_a_line_if_jax_is_not_installed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(OmniError, match=r"physics.backend = jax needs the package jax"):
        om.Simulation(om.load_scenario("rect", plant="planar", physics={"backend": "jax"}), ["flc"])
    assert om.Simulation(om.load_scenario("rect", plant="planar", reference={"laps": 300}), ["flc"])


@pytest.mark.parametrize("plant", ["mujoco", "kinematic"])
def test_jax_is_refused_for_plants_that_it_does_not_compute(plant: str) -> None:
    with pytest.raises(OmniError, match=f"planar only, not on {plant}"):
        om.Simulation(om.load_scenario("rect", plant=plant, physics={"backend": "jax"}), ["flc"])
