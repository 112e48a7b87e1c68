"""Sweeps that other processes run: every row once and to the bit what it is here, whoever is killed meanwhile."""

import gc
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pyarrow as pa
import pytest
from distributed import Client, LocalCluster

import omni_mj as om
from omni_mj.cli.sweep import command
from omni_mj.studies import sweep
from omni_mj.studies.outcome import nothing
from omni_mj.studies.sweep import elsewhere
from omni_mj.studies.sweep.plan import Job

SHORT = {"waypoints": [[0, 0], [0.2, 0.1]], "settle_s": 0.2}
VARY = {"radio.delay_frames": [0, 4], "kinematic.alpha_low": [0.7, 0.9]}
NAMES = ["p", "flc"]


def scenario() -> om.Scenario:
    return om.scenario("rect", plant="kinematic", reference=SHORT)


def bits(table: pa.Table) -> dict[str, list[str]]:
    """All of a table; of numbers every bit, and what is none equal to what is none."""
    return {name: list(map(repr, table[name].to_pylist())) for name in table.column_names}


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    folder = tmp_path_factory.mktemp("sweep") / "here"
    return bits(sweep.sweep(scenario(), VARY, NAMES, range(3), out=folder).rows())


@pytest.fixture(scope="module")
def workers() -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """The address of a scheduler, and two workers, processes of their own that share nothing with this one.

    All are there; how soon they answer says how busy a computer is.
    """
    command = [sys.executable, "-m", "distributed.cli.dask_worker", "--no-nanny", "--nthreads", "1", "--no-dashboard"]
    cluster = LocalCluster(n_workers=0, dashboard_address=None, silence_logs=50)
    with pytest.MonkeyPatch.context() as patient, cluster as scheduler:
        patient.setattr(elsewhere, "ANSWER_S", 120.0)
        address = scheduler.scheduler_address
        processes = [subprocess.Popen([*command, address], stderr=subprocess.DEVNULL) for _ in range(2)]
        with Client(address) as client:
            client.wait_for_workers(2, timeout=120)
        yield address, processes
        for process in processes:
            process.kill()
            process.wait()


def test_a_cluster_of_which_a_worker_is_killed_finds_the_same(
    here: dict[str, list[str]], workers: tuple[str, list[subprocess.Popen[bytes]]], tmp_path: Path
) -> None:
    """Killed when two of twelve shards are done and others are on their way."""
    done: list[int] = []
    address, processes = workers

    def kill_one(job: Job) -> Callable[[int], None]:
        done.append(job.number)
        if len(done) == 2:
            processes[0].kill()
        return nothing

    found = sweep.sweep(
        scenario(), VARY, NAMES, range(3), out=tmp_path / "there", at_once=2, cluster=address, before_shard=kill_one
    )
    assert found.complete
    assert sorted(done) == [job.number for job in found.plan.jobs] == list(range(12))
    assert bits(found.rows()) == here


def test_a_worker_of_another_version_is_refused(
    workers: tuple[str, list[subprocess.Popen[bytes]]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Told of this side's, which here are wrong: what is refused is what a worker finds to be otherwise than it is."""
    true = elsewhere._same()
    monkeypatch.setattr(elsewhere, "_same", lambda: {**true, "mujoco": "1.2.3"})
    with Client(workers[0]) as client, pytest.raises(om.OmniError, match=r"mujoco 4\S*, not 1\.2\.3"):
        sweep.sweep(scenario(), VARY, NAMES, out=tmp_path / "sweep", cluster=client)


def test_processes_of_this_machine_find_the_same(here: dict[str, list[str]], tmp_path: Path) -> None:
    found = sweep.sweep(scenario(), VARY, NAMES, range(3), out=tmp_path / "sweep", at_once=8, jobs=2)
    assert len(found.plan.jobs) == 3
    assert bits(found.rows()) == here


def test_what_cannot_be_is_said_in_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def clients() -> int:
        return sum(isinstance(each, Client) for each in gc.get_objects())

    monkeypatch.setattr(elsewhere, "ANSWER_S", 0.2)
    gc.collect()
    before = clients()
    for given, words in (
        ({"jobs": 0}, "jobs must be at least 1, not 0"),
        ({"jobs": 2, "cluster": "tcp://127.0.0.1:9"}, "processes of this machine, or a cluster"),
        ({"cluster": "tcp://127.0.0.1:9"}, "no Dask scheduler answers at tcp://127.0.0.1:9"),
        ({"cluster": "nonsense"}, "no Dask scheduler answers at nonsense"),
    ):
        with pytest.raises(om.OmniError, match=words):
            sweep.sweep(scenario(), VARY, NAMES, out=tmp_path / "none", **given)
    assert clients() == before, "one that is left over is finalized where it keeps the next from starting"
    begin = ["--scenario", "rect", "--vary", "carpet.friction=0.5", "--quiet", "--out", str(tmp_path / "other")]
    with pytest.raises(om.OmniError, match="no Dask scheduler answers at nonsense"):
        command.main([*begin, "--cluster", "nonsense"], standalone_mode=False)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(om.OmniError, match=r"omni-mj\[cluster\]"):
        sweep.sweep(scenario(), VARY, NAMES, out=tmp_path / "none", cluster="tcp://127.0.0.1:9")
