"""Laws of the preview MPC: prediction, solution of its programs, limits, and the LQR limit."""

import numpy as np
from benches.control import Array, CommandConstraints, make_controller, solve_quadratic_programs
from closed_loop import LaggedPlant, T, run_controller
from commands import run_python
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize

from omni_control import MotionLimits, TeamModel, TimedReference
from omni_control.install_hints import describe_installation


def make_programs(
    seed: int, n: int, frames: int, relative_change: float
) -> tuple[Array, Array, CommandConstraints]:
    """Return programs whose planned commands change by about `relative_change` of the limits."""
    rng = np.random.default_rng(seed)
    root = np.tril(rng.normal(size=(n, 2 * frames, 2 * frames)))
    hessian = root @ root.swapaxes(1, 2) / frames + np.eye(2 * frames)
    planned = np.cumsum(0.08 * relative_change * rng.normal(size=(frames + 1, n, 2)), axis=0)
    angles = rng.uniform(0, 7, (frames, n))
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return (
        hessian,
        0.1 * relative_change * rng.normal(size=(n, 2 * frames)),
        CommandConstraints(planned[0], planned[1:], directions, 0.08, 0.3),
    )


def compute_violation(limits: CommandConstraints, robot: int, w: Array) -> Array:
    """Return the violation of the limits: sides of the octagons, computed from their corners."""
    last_command, planned, directions = (
        values[..., 0] + 1j * values[..., 1] for values in limits[:3]
    )
    sent = planned[:, robot] + w[0::2] + 1j * w[1::2]
    change = np.diff(sent, prepend=last_command[robot])
    corners = directions[:, robot, None] * np.exp(0.25j * np.pi * np.arange(9))
    middles = (corners[:, :-1] + corners[:, 1:]) / 2

    def project(vectors: Array) -> Array:
        return (vectors * middles.conj()).real / np.abs(middles)

    inradius = np.abs(middles)
    max_speed = np.maximum(limits.max_speed * inradius, project(last_command[robot]))
    violations = (
        project(change[:, None]) - limits.max_step * inradius,
        project(sent[:, None]) - max_speed,
    )
    return np.concatenate([violation_i.ravel() for violation_i in violations])


@settings(max_examples=12)
@given(seed=st.integers(0, 999))
def test_programs_agree_with_another_solver(seed: int) -> None:
    """Compare with sequential quadratic programming that starts from the last command."""
    hessian, gradient, limits = make_programs(seed, 2, 4, 1.5)
    best, _ = solve_quadratic_programs(hessian, gradient, limits)
    for i in range(2):

        def cost(w: Array, i: int = i) -> float:
            return float(w @ hessian[i] @ w / 2 + gradient[i] @ w)

        start = (limits.last_command[i] - limits.planned[:, i]).ravel()
        reference_solution = optimize.minimize(
            cost, start, jac=lambda w, i=i: hessian[i] @ w + gradient[i], method="SLSQP",
            constraints={"type": "ineq", "fun": lambda w, i=i: -compute_violation(limits, i, w)},
            options={"ftol": 1e-13, "maxiter": 500},
        )  # fmt: skip
        solution = best[i].ravel()
        assert compute_violation(limits, i, solution).max() < 1e-8, (
            "piqp keeps to limits as exactly as it is asked to, 1e-9"
        )
        # Curvature is at least 1: a cost that is 1e-8 too high is a way of at most 1.5e-4 off.
        assert abs(cost(solution) - reference_solution.fun) < 1e-8
        np.testing.assert_allclose(solution, reference_solution.x, rtol=0, atol=2e-4)


def test_programs_are_solved_independently() -> None:
    """Bit for bit, with and without active limits."""
    hessian, gradient, limits = make_programs(1, 8, 12, 1.0)
    gradient[::2] = 0
    planned = limits.planned.copy()
    planned[:, ::2] = limits.last_command[::2]
    limits = limits._replace(planned=planned)
    best, is_constrained = solve_quadratic_programs(hessian, gradient, limits)
    assert 0 < is_constrained.sum() < len(is_constrained)
    for i in range(8):
        row = slice(i, i + 1)
        row_constraints = CommandConstraints(
            limits.last_command[row],
            limits.planned[:, row],
            limits.directions[:, row],
            limits.max_step,
            limits.max_speed,
        )
        single, _ = solve_quadratic_programs(hessian[row], gradient[row], row_constraints)
        assert np.array_equal(single[0], best[i])


def test_programs_are_feasible_after_any_last_command() -> None:
    """The last command may exceed all limits: repeating it is feasible, and the robot brakes."""
    hessian, gradient, limits = make_programs(3, 4, 12, 0.1)
    fast = limits._replace(
        last_command=limits.last_command + np.array([5.0, 0.0]),
        directions=np.tile([1.0, 0.0], (12, 4, 1)),
    )
    best, is_constrained = solve_quadratic_programs(hessian, gradient, fast)
    assert is_constrained.all()
    first_command = fast.planned[0] + best[:, 0]
    assert np.isfinite(best).all()
    assert ((first_command - fast.last_command)[:, 0] < -0.079).all(), "as fast as it may"


def test_unsolved_programs_yield_nan_for_that_robot_only() -> None:
    """Two robots; the reference of one is NaN."""
    hessian, gradient, limits = make_programs(4, 2, 6, 2.0)
    gradient[1] = np.nan
    limits.planned[:, 1] = np.nan
    best, _ = solve_quadratic_programs(hessian, gradient, limits)
    assert np.isfinite(best[0]).all()
    assert np.isnan(best[1]).all()


def test_commands_satisfy_the_limits() -> None:
    """The reference exceeds the limits. Speed may exceed the octagon where the last command did."""
    limits = MotionLimits(1.0, 4.7, 26.0, 50.8)
    reference = TimedReference(
        [[0, 0, 0], [1.5, 0, 0], [1.5, 1.0, 0]], MotionLimits(1.2, 4.5), T
    ).with_rest(15)
    model = TeamModel(T, 4, lag_s=0.02, position_noise_m=0, heading_noise_rad=0, limits=limits)
    accelerations, speeds = [], []

    def record(command: Array, last_command: Array) -> Array:
        accelerations.append(np.hypot(*(command - last_command)[0, :2]) / T)
        speeds.append(np.hypot(*command[0, :2]))
        return command

    plant = LaggedPlant(np.zeros((1, 3)), 4, alpha=0.9)
    run = run_controller(
        make_controller("mpc", model, reference, 1), plant, reference.frames, limits=record
    )
    assert (
        max(accelerations) < 4.7 + 1e-5
    )  # 1e-9 m/s to which programs are solved, in a frame of 1/60 s, and some rounding
    assert max(accelerations) > 4.6, "the limit counts"
    assert 0.99 < max(speeds) < 1.0 / np.cos(np.pi / 8)
    assert np.isfinite(run.sent).all()


def test_the_list_of_controllers_names_missing_packages() -> None:
    code = (
        "import sys; sys.modules['piqp'] = None; "
        "from omni_control.controllers.registry import CONTROLLERS, list_available_controllers; "
        "assert set(CONTROLLERS) - set(list_available_controllers()) == {'mpc'}; "
        "from omni_mj.cli.main import main; sys.argv = ['omni-mj', 'list']; main()"
    )
    done = run_python(code=code)
    assert done.returncode == 0, done.stderr
    assert f"needs piqp: {describe_installation('mpc')}" in " ".join(done.stdout.split())
