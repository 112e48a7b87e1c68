"""Sweeps: every run once, the same as alone, whatever the batch and however often the sweep was killed."""

import json
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import invoke
from scipy.optimize import brentq

import omni_mj as om
from omni_control.errors import OmniError
from omni_mj.scenarios import rows
from omni_mj.studies import sweep
from omni_mj.studies.outcome import StoppedError, nothing
from omni_mj.studies.sweep import cells, shard
from omni_mj.studies.sweep.plan import Job, Plan

SHORT = {"waypoints": [[0, 0], [0.2, 0.1]], "settle_s": 0.2}
VARY = {"radio.delay_frames": [0, 4], "kinematic.alpha_low": [0.7, 0.9]}
NAMES = ["p", "flc"]


def scenario(**sections: object) -> om.Scenario:
    return om.scenario("rect", plant="kinematic", reference=SHORT, **sections)


def bits(table: pa.Table) -> dict[str, list[str]]:
    """All of a table; of numbers every bit, and what is none equal to what is none."""
    return {name: list(map(repr, table[name].to_pylist())) for name in table.column_names}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> sweep.Sweep:
    return sweep.sweep(scenario(), VARY, NAMES, range(3), out=tmp_path_factory.mktemp("sweep") / "whole")


def test_each_run_is_what_it_is_alone(whole: sweep.Sweep) -> None:
    """Bit for bit, at each point; and all are there, once."""
    table = whole.rows()
    assert table.num_rows == 2 * 2 * 2 * 3
    for point, values in enumerate(whole.plan.points):
        sections: dict[str, dict[str, object]] = {}
        for name, value in values.items():
            sections.setdefault(name.split(".")[0], {})[name.split(".")[1]] = value
        alone = om.run(scenario(**sections), NAMES, range(3)).rows()
        own = table.filter(pa.compute.equal(table["point"], point))
        alone, own = bits(alone), bits(own)
        shared = [name for name in alone if name in own and name != "failed_at_s"]
        assert {"controller", "seed", "settle_s", "distance_p99_m", "heading_rms_rad", "held_back_share"} <= {*shared}
        for name in shared:
            assert own[name] == alone[name], name
        assert set(own["radio.delay_frames"]) == {repr(values["radio.delay_frames"])}


class Gone(om.Controller):
    """Fails in its 600th frame, when the first block has been measured."""

    def command(self, frame: int, seen: om.Seen) -> np.ndarray:
        if frame == 600:
            raise RuntimeError("gone")
        return np.zeros((len(seen.pose), 3))


def long(seconds: float) -> Plan:
    """Of robots that rest at the end for so long, half of which fail before; vision is away for a while."""
    out = {"kind": "vision-out", "at": 8.0, "for": 1.0}
    chosen = om.scenario("rect", plant="kinematic", reference={**SHORT, "settle_s": seconds}, fault=(out,))
    return Plan(chosen.replace(controllers=("p", Gone), seeds=10), sweep.axes({"radio.delay_frames": [4]}))


def test_runs_longer_than_a_block_have_the_numbers_of_the_whole() -> None:
    """To the bit; what is not known is not known in both."""
    plan = long(12.0)
    found = shard.run(plan, plan.jobs[0])
    whole = om.run(plan.there[0]).outcomes[0]
    assert len(whole.failures) == 10
    order = rows.numbers(whole.rows, plan.rows(plan.jobs[0]))
    for name, values in whole.measured.items():
        np.testing.assert_array_equal(found[name].to_numpy(), values[order], err_msg=name)


@pytest.mark.usefixtures("whole")  # by which all is imported
def test_memory_does_not_grow_with_the_length_of_runs() -> None:
    """20 robots for 8 s longer: their frames would be 6 MB more, what is kept of them is a twentieth at most."""
    highest = []
    for seconds in (10.0, 18.0):
        plan = long(seconds)
        _ = plan.frames
        tracemalloc.start()
        try:
            shard.run(plan, plan.jobs[0])
            highest.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert highest[1] - highest[0] < 0.05 * 20 * 8 * 60 * 600


@pytest.mark.parametrize("at_once", [1, 5])
def test_results_do_not_depend_on_how_many_run_at_once(whole: sweep.Sweep, tmp_path: Path, at_once: int) -> None:
    again = sweep.sweep(scenario(), VARY, NAMES, range(3), out=tmp_path / "sweep", at_once=at_once)
    assert len(again.plan.jobs) > len(whole.plan.jobs)
    assert bits(again.rows()) == bits(whole.rows())


def test_a_sweep_that_was_stopped_goes_on_and_computes_nothing_twice(whole: sweep.Sweep, tmp_path: Path) -> None:
    run: list[int] = []

    def three_at_most(job: Job) -> object:
        if len(run) == 3:
            raise StoppedError("enough")
        run.append(job.number)
        return nothing

    folder = tmp_path / "sweep"
    part = sweep.sweep(scenario(), VARY, NAMES, range(3), out=folder, at_once=4, before_shard=three_at_most)
    assert (part.done, part.stopped, part.complete) == (3, "enough", False)
    assert part.rows().num_rows == sum(len(NAMES) * len(job.runs) for job in part.plan.jobs[:3])
    assert json.loads((folder / "summary.json").read_text())["complete"] is False
    rest: list[int] = []
    done = sweep.resume(folder, before_shard=lambda job: rest.append(job.number) or nothing)
    assert done.complete
    assert sorted(run + rest) == [job.number for job in done.plan.jobs]
    assert bits(done.rows()) == bits(whole.rows())
    sweep.resume(folder, before_shard=lambda job: pytest.fail("nothing is left"))


def test_a_killed_process_loses_no_shard_that_was_done(
    whole: sweep.Sweep, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Killed as soon as two shards are on the disk; another process, this one, goes on."""
    folder = tmp_path / "sweep"
    begin = [
        sys.executable, "-m", "omni_mj.cli.main", "sweep", "--quiet",
        "--scenario", "rect", "--plant", "kinematic", "--seeds", "3", "--at-once", "2", "--out", str(folder),
        "--vary", "radio.delay_frames=0:4:4", "--vary", "kinematic.alpha_low=0.7,0.9", "--controller", "p",
        "--controller", "flc", "--set", "reference.waypoints=[[0, 0], [0.2, 0.1]]", "--set", "reference.settle_s=0.2",
    ]  # fmt: skip
    process = subprocess.Popen(begin)
    deadline = time.monotonic() + 120
    while len(list(folder.glob("shards/*.parquet"))) < 2 and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.002)
    process.kill()
    process.wait()
    kept = {path.name: path.stat().st_mtime_ns for path in folder.glob("shards/*.parquet")}
    assert len(kept) >= 2
    assert invoke("sweep", "--quiet", "--resume", folder) == 0
    assert capsys.readouterr() == ("", "")
    table = pq.read_table(folder / "rows.parquet")
    assert bits(table) == bits(whole.rows())
    assert (folder / "sweep.png").stat().st_size > 10_000
    assert "kinematic.alpha_low" in (folder / "sweep.md").read_text()


def test_what_is_not_allowed_is_said_in_a_line(tmp_path: Path) -> None:
    for vary, words in (
        ({"carpet.fricton": [1]}, "unknown setting carpet.fricton"),
        ({"carpet.friction": []}, "1 to 1000 values"),
        ({"carpet.friction": [0.5, 0.5]}, "each once"),
        ({"carpet.friction": [0.5, 50.0]}, "carpet.friction must be"),
    ):
        with pytest.raises(OmniError, match=words):
            sweep.sweep("rect", vary, NAMES, out=tmp_path / "none")
    with pytest.raises(OmniError, match="GB, and there are"):
        sweep.sweep(scenario(), {"radio.delay_frames": range(400)}, NAMES, range(10_000), out=tmp_path / "none",
                    at_once=8_000_000)  # fmt: skip
    assert not (tmp_path / "none").exists()
    sweep.sweep(scenario(), {"radio.delay_frames": [0]}, ["p"], out=tmp_path / "one")
    with pytest.raises(OmniError, match="holds another sweep"):
        sweep.sweep(scenario(), {"radio.delay_frames": [1]}, ["p"], out=tmp_path / "one")


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("carpet.friction=0.3:1.0:8", [0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]),
        ("radio.delay_frames=0:12:4", [0, 4, 8, 12]),
        ("radio.delay_frames=1,2,6", [1, 2, 6]),
        ("wheels.model=rollers,two-rollers", ["rollers", "two-rollers"]),
        ("carpet.friction=1,0.5", [1.0, 0.5]),
    ],
)
def test_axes_are_read_as_they_are_written(text: str, values: list[object]) -> None:
    assert list(sweep.axis(text).values) == values


@pytest.mark.parametrize(
    "text",
    ["carpet.friction", "carpet.friction=0.3:1.0", "carpet.friction=1.0:0.3:8", "radio.delay_frames=0:12:0",
     "wheels.model=0:1:2", "radio.delay_frames=0:1.5:2", "carpet.friction=0.3:1.0:1", "nothing.at_all=1:2:3"],
)  # fmt: skip
def test_axes_that_cannot_be_read_are_refused(text: str) -> None:
    with pytest.raises(OmniError):
        sweep.axis(text)


@pytest.mark.parametrize(("failed", "count"), [(0, 20), (1, 20), (10, 20), (20, 20), (3, 1000)])
def test_the_interval_of_a_rate_is_where_the_normal_test_accepts_it(failed: int, count: int) -> None:
    """Its ends p solve |failed / count - p| = z sqrt(p (1 - p) / count), found here by bisection."""
    rate, z = failed / count, 1.959963984540054

    def beyond(p: float) -> float:
        return abs(rate - p) - z * np.sqrt(p * (1 - p) / count)

    low, high = cells.wilson(failed, count)
    assert low == pytest.approx(0.0 if failed == 0 else brentq(beyond, 1e-12, min(rate, 1 - 1e-6)), abs=1e-9)
    assert high == pytest.approx(1.0 if failed == count else brentq(beyond, max(rate, 1e-6), 1 - 1e-12), abs=1e-9)


@pytest.mark.parametrize("n", [6, 20, 51])
def test_the_interval_of_a_median_covers_it_as_often_as_it_says(n: int) -> None:
    """Of 4,000 samples at least 95 %, less three deviations of the binomial law (1 %); skewed, and some infinite."""
    random = np.random.default_rng(n)
    samples = np.exp(random.normal(size=(4000, n)))  # whose median is 1
    samples[samples > 5] = np.inf
    found = np.array([cells.median(each) for each in samples])
    assert ((found[:, 1] <= 1) & (found[:, 2] >= 1)).mean() > 0.94
    assert np.isnan(cells.median(samples[0, :5])[1:]).all()


def test_rows_that_cannot_share_a_batch_are_run_apart() -> None:
    """Wheels of two sorts in one sweep on the MuJoCo plant: a shard holds one sort only."""
    vary = {"wheels.model": ["rollers", "two-rollers"], "carpet.friction": [0.5, 0.8]}
    plan = Plan(om.scenario("rect", controllers=["p"], seeds=2), sweep.axes(vary))
    assert [len(job.runs) for job in plan.jobs] == [4, 4]
    for job in plan.jobs:
        assert len({row.settings.wheels for row in plan.rows(job)}) == 1
