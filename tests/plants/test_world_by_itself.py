"""A world by itself beside a batch of one: the same bits, by any way of stepping it."""

import mujoco as mj
import numpy as np
import pytest
from driving import mujoco, quiet
from mujoco.batch import Batch
from omni_mj.onboard.kernel import compiled
from omni_mj.plants.alone import STATE, Alone, step

from omni_mj.link.radio import Received
from omni_mj.plants import batches
from omni_mj.worlds import build

FIELDS = "dof_frictionloss", "dof_solimp", "actuator_gainprm", "geom_pos", "opt.gravity"


def two_robots() -> build.World:
    return build.world(quiet().replace(wheels={"model": "two-rollers"}), places=2)


def standing(made: type[Alone] | type[Batch]) -> Alone | Batch:
    world = two_robots()
    one = Alone(batches.model_of(world)) if made is Alone else Batch(batches.model_of(world), 1, 1)
    one.bind("sensordata")  # a batch copies what is asked for before it steps
    one.bind("qpos")[0] = world.standing
    one.bind("qpos")[0, world.robots[1].qpos[1]] = 0.179  # hulls touch
    one.forward()
    return one


@pytest.mark.parametrize("way", ["as written", "compiled"])
def test_it_steps_as_a_batch_of_one_does(way: str) -> None:
    """Driven by voltages and pushes, with fields of the model that change: MuJoCo's own step and sensors, on copies."""
    if way == "compiled":
        pytest.importorskip("numba")
    batch, alone = standing(Batch), standing(Alone)
    assert isinstance(alone, Alone)
    rng = np.random.default_rng(1)
    for number in range(40):
        voltages, push = rng.normal(0, 4, alone.bind("ctrl").shape), rng.normal(0, 2, 3)
        for one in (batch, alone):
            one.bind("ctrl")[:] = voltages
            one.bind("xfrc_applied")[0, 1, :3] = push
            one.expand("dof_frictionloss")[0, -4:] = 0.01 * number
            one.expand("opt.gravity")[0, 0] = 0.1 * number
        batch.step()
        if way == "as written":
            alone.step()
        else:
            compiled(step)(alone.stepping)
    for name in (*STATE, "sensordata"):
        np.testing.assert_array_equal(alone.bind(name), batch.bind(name), name)
    for name in FIELDS:
        np.testing.assert_array_equal(alone.expand(name), batch.expand(name), name)


def test_a_copy_of_it_senses_loads_as_it_does() -> None:
    alone = standing(Alone)
    alone.step()
    model, data = alone.get_model(), alone.get_data()
    mj.mj_forward(model, data)
    alone.forward()
    np.testing.assert_array_equal(data.sensordata, alone.bind("sensordata")[0])
    assert data.sensordata[two_robots().loads].sum() > 0.0


def test_a_world_that_is_not_among_those_to_be_stepped_stands_still() -> None:
    alone = standing(Alone)
    before = alone.state.copy()
    alone.step(np.zeros(0, int))
    alone.forward(np.zeros(0, int))
    np.testing.assert_array_equal(alone.state, before)


def test_what_is_written_into_its_state_is_in_its_fields() -> None:
    alone = standing(Alone)
    for name in STATE:
        field = alone.bind(name)
        offset = (field.ctypes.data - alone.state.ctypes.data) // alone.state.itemsize
        alone.state[0, offset + field.size - 1] = 7.0
        assert field.ravel()[-1] == 7.0


def test_it_counts_what_mujoco_warns_of(tmp_path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.chdir(tmp_path)  # MuJoCo logs its warnings to a file in the working directory
    alone = standing(Alone)
    alone.bind("qvel")[0, 3] = 1e12
    alone.step()
    kind = int(mj.mjtWarning.mjWARN_BADQVEL)
    assert alone.warning[0, kind, 1] == 1
    assert np.count_nonzero(batches.warnings(alone)) == 1
    alone.warning[:] = 0
    alone.step()
    assert not batches.warnings(alone).any()


@pytest.mark.parametrize("substeps", [1, 2])
def test_a_frame_in_parts_is_the_frame(substeps: int) -> None:
    """Of compiled loops: at once, cycle by cycle, and in parts of any length."""
    found = []
    for parts in ([16], [1] * 16, [5, 1, 7, 3]):
        plant = mujoco([quiet(physics={"substeps": substeps})])
        for frame in range(3):
            received = Received.at_once(np.array([[0.8, 0.3 * frame, 2.0]]), plant.pose()[:, 2])
            for number, count in enumerate(parts):
                assert plant.go(count, received if number == 0 else None) == {}
        found.append((plant._batch.bind("qpos").copy(), plant.currents.copy(), plant.telemetry().battery))
    for other in found[1:]:
        for one, same in zip(found[0], other, strict=True):
            np.testing.assert_array_equal(same, one)
