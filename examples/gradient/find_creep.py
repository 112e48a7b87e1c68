"""Find the creep stiffness of a robot from one drive, by the gradient of the planar plant.

JAX differentiates the plant's own equations (extra `fast`): how the end of a drive changes with a number of the robot.
A robot whose wheels creep more than the catalogue says is driven once. Newton's method then finds its stiffness from
where it ended.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

import omni_mj as om
from omni_mj.config.rows import Row
from omni_mj.plants.planar import PlanarPlant
from omni_mj.robot.firmware import FirmwareCommand
from omni_mj.robot.onboard import make_undisturbed_inputs
from omni_mj.robot.planar_frame import PlanarParameters, PlanarState, advance_frame

FRAMES, TRUE_STIFFNESS = 60, 2.0


def robot() -> tuple[PlanarParameters, PlanarState]:
    """Return parameters and state at rest of the default robot, as arrays of JAX."""
    settings = om.load_scenario("rect", plant="planar", physics={"backend": "numpy"}).settings
    plant = PlanarPlant([Row(0, 0, "", 0, settings, "tigers-v2016")], np.zeros((1, 3)))
    parameters, state = jax.tree.map(jnp.asarray, (plant.parameters, plant.state))
    return parameters, state


def travel(
    parameters: PlanarParameters, state: PlanarState, stiffness: float | jax.Array
) -> jax.Array:
    """Return how far the robot is ahead after a second at a rising speed, m."""
    carpet = parameters.carpet
    soft = 1 / (carpet.radius**2 * stiffness)
    parameters = parameters._replace(carpet=carpet._replace(creep_compliance=soft))
    inputs, none = jax.tree.map(jnp.asarray, make_undisturbed_inputs(1)), jnp.zeros(1)

    def frame(state: PlanarState, speed: jax.Array) -> tuple[PlanarState, None]:
        command = FirmwareCommand(speed[None], none, none, jnp.ones(1, bool))
        return advance_frame(parameters, state, command, inputs)[0], None

    state, _ = jax.lax.scan(frame, state, jnp.linspace(0.0, 2.0, FRAMES))
    return state.body.x[0]


def main() -> None:
    """Print the stiffness after each step of Newton's method."""
    with jax.enable_x64(True):
        drive = partial(travel, *robot())
        # One number is differentiated: forwards is cheaper than `jax.grad`.
        value_and_slope = jax.jit(lambda stiffness: jax.jvp(drive, (stiffness,), (1.0,)))
        measured, _ = value_and_slope(TRUE_STIFFNESS)
        stiffness = 3.5
        for step in range(6):
            value, slope = value_and_slope(stiffness)
            print(
                f"step {step}: creep stiffness {stiffness:.4f}, {1e3 * (value - measured):+.3f} mm off"
            )
            stiffness = float(stiffness + (measured - value) / slope)
    print(f"found {stiffness:.3f}, true {TRUE_STIFFNESS:.3f}")


if __name__ == "__main__":
    main()
