"""Identify the creep stiffness of a robot from one drive, by the gradient of the planar plant.

JAX (extra `fast`) computes the derivative of a drive's final position by a parameter of the robot.
Here the wheels of the robot creep more than nominal. Newton's method finds their creep stiffness
from the final position.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

import omni_mj as om
from omni_mj.config.rows import Row
from omni_mj.plants.planar_plant import PlanarPlant
from omni_mj.robot.firmware_state import FirmwareCommand, make_undisturbed_inputs
from omni_mj.robot.planar_robot import PlanarParameters, PlanarState, advance_frame

N_FRAMES = 60
TRUE_STIFFNESS = 2.0
INITIAL_GUESS = 3.5


def make_robot() -> tuple[PlanarParameters, PlanarState]:
    """Return parameters and state at rest of the default robot, as arrays of JAX."""
    settings = om.load_scenario("rect", plant="planar", physics={"backend": "numpy"}).settings
    plant = PlanarPlant([Row(0, 0, "", 0, settings, "tigers-v2016")], np.zeros((1, 3)))
    parameters, state = jax.tree.map(jnp.asarray, (plant.parameters, plant.state))
    return parameters, state


def drive(parameters: PlanarParameters, state: PlanarState, stiffness: float) -> jax.Array:
    """Return the forward position after a second of rising speed, m."""
    carpet = parameters.carpet
    carpet = carpet._replace(
        creep_compliance=1 / (carpet.radius**2 * stiffness),
        sliding_slip=jnp.full_like(carpet.sliding_slip, 3 / stiffness),
    )
    parameters = parameters._replace(carpet=carpet)
    inputs = jax.tree.map(jnp.asarray, make_undisturbed_inputs(1))

    def step(state: PlanarState, speed: jax.Array) -> tuple[PlanarState, None]:
        command = FirmwareCommand(jnp.array([[speed], [0.0], [0.0]]), jnp.ones(1, bool))
        state, _ = advance_frame(parameters, state, command, inputs)
        return state, None

    state, _ = jax.lax.scan(step, state, jnp.linspace(0.0, 2.0, N_FRAMES))
    return state.body.x[0]


def main() -> None:
    """Print the creep stiffness after each step of Newton's method."""
    with jax.enable_x64(True):
        drive_robot = partial(drive, *make_robot())
        # For a derivative by one parameter, forward mode is cheaper than `jax.grad`.
        position_and_slope = jax.jit(lambda stiffness: jax.jvp(drive_robot, (stiffness,), (1.0,)))
        measured_position, _ = position_and_slope(TRUE_STIFFNESS)
        stiffness = INITIAL_GUESS
        for iteration in range(6):
            position, slope = position_and_slope(stiffness)
            error_mm = 1e3 * (position - measured_position)
            print(
                f"step {iteration}: creep stiffness {stiffness:.4f}, position error "
                f"{error_mm:+.3f} mm"
            )
            stiffness = float(stiffness + (measured_position - position) / slope)
    print(f"identified {stiffness:.3f}, true {TRUE_STIFFNESS:.3f}")


if __name__ == "__main__":
    main()
