"""Test that sweeps run each run once and equal separate runs, whatever batch and process."""

import gc
import json
import os
import pickle
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from benches import studies as bench
from commands import invoke, run_python, split_words

import omni_mj as om

SHORT = {"waypoints": [[0, 0], [0.2, 0.1]], "settle_s": 0.2}
ROUTE = "--set reference.waypoints=[[0, 0], [0.2, 0.1]] --set reference.settle_s=0.2"
VARY = {"radio.delay_frames": [0, 4], "kinematic.alpha_low": [0.7, 0.9]}
NAMES = ["p", "flc"]
LONG = om.load_scenario("rect", plant="kinematic", reference={"laps": 300})


def scenario(**sections: object) -> om.Scenario:
    return om.load_scenario("rect", plant="kinematic", reference=SHORT, **sections)


def run_sweep(folder: Path, **options: Any) -> bench.SweepResult:
    return bench.sweep(scenario(), VARY, NAMES, range(3), out=folder, **options)


def sweep_command(folder: Path) -> list[str]:
    """Return the command of the same sweep."""
    return split_words(
        f"sweep --quiet {ROUTE} --scenario rect --plant kinematic --seeds 3 --batch-size 2",
        "--vary radio.delay_frames=0:4:2 --vary kinematic.alpha_low=0.7,0.9",
        "--controller p --controller flc --out",
        folder,
    )


def bits(table: pa.Table) -> dict[str, list[str]]:
    """Return the columns of a table as text with all digits; NaN equals NaN."""
    return {name: list(map(repr, table[name].to_pylist())) for name in table.column_names}


@pytest.fixture(scope="module")
def complete_sweep(tmp_path_factory: pytest.TempPathFactory) -> bench.SweepResult:
    return run_sweep(tmp_path_factory.mktemp("sweep") / "complete")


def test_a_shard_leaves_no_simulation_behind(complete_sweep: bench.SweepResult) -> None:
    """Nothing waits for the collection of garbage, whose time grows with the number of points."""

    def count_simulations() -> int:
        return sum(isinstance(thing, om.Simulation) for thing in gc.get_objects())

    gc.collect()
    gc.disable()
    try:
        before = count_simulations()  # of other tests
        bench.run_shard(complete_sweep.plan, complete_sweep.plan.shards[0])
        assert count_simulations() == before
    finally:
        gc.enable()


def test_runs_equal_those_outside_a_sweep(complete_sweep: bench.SweepResult) -> None:
    """Bit for bit at each point, and each run once."""
    table = complete_sweep.rows()
    assert table.num_rows == 2 * 2 * 2 * 3
    for point in range(len(complete_sweep.plan.points)):
        sections: dict[str, dict[str, object]] = {}
        for name, value in complete_sweep.plan.points[point].items():
            sections.setdefault(name.split(".")[0], {})[name.split(".")[1]] = value
        single_runs = bits(om.run(scenario(**sections), NAMES, range(3)).rows())
        swept = bits(table.filter(pa.compute.equal(table["point"], point)))
        shared = [name for name in single_runs if name in swept and name != "failed_at_s"]
        assert {
            "controller",
            "seed",
            "settle_s",
            "position_p99_m",
            "heading_rms_rad",
            "command_limited_fraction",
        } <= {*shared}
        for name in shared:
            assert swept[name] == single_runs[name], name


def test_robots_with_different_wheels_do_not_share_a_batch(tmp_path: Path) -> None:
    """On planar all rows of a batch have the wheels of its first row."""
    single_runs = [
        om.run(
            om.load_scenario("rect", plant="planar", reference=SHORT, wheels={"rollers": n}), "p"
        )
        for n in (12, 16)
    ]
    result = bench.sweep(
        om.load_scenario("rect", plant="planar", reference=SHORT),
        {"wheels.rollers": [12, 16]},
        ["p"],
        1,
        out=tmp_path / "x",
    )
    assert result.rows()["position_max_m"].to_pylist() == [
        run.rows()["position_max_m"][0].as_py() for run in single_runs
    ]


def test_stopped_sweep_continues_without_repeating_shards(
    complete_sweep: bench.SweepResult, tmp_path: Path
) -> None:
    frames: list[int] = []

    def stop_after_three(title: str, n_frames: int) -> Callable[[int], None]:
        frames.append(n_frames)

        def after_frame(frame: int) -> None:
            if len(list(folder.glob("shards/*.parquet"))) == 3:
                raise bench.StoppedError("enough")

        return after_frame

    def count_frames(title: str, n_frames: int) -> Callable[[int], None]:
        frames.append(n_frames)
        return bench.ignore_frame

    folder = tmp_path / "sweep"
    partial = run_sweep(folder, batch_size=4, start_progress=stop_after_three)
    assert (partial.n_done, partial.stopped, partial.complete) == (3, "enough", False)
    assert partial.rows().num_rows == sum(
        len(NAMES) * len(shard.runs) for shard in partial.plan.shards[:3]
    )
    assert json.loads((folder / "summary.json").read_text())["complete"] is False
    done = run_sweep(folder, batch_size=4, start_progress=count_frames)
    assert bits(done.rows()) == bits(complete_sweep.rows())
    run_sweep(folder, batch_size=4, start_progress=count_frames)
    n_shards = len(done.plan.shards)
    assert frames == [done.plan.frames * count for count in (n_shards, n_shards - 3, 0)]


def test_killed_process_loses_no_finished_shard(
    complete_sweep: bench.SweepResult, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Kill a process when two shards are stored, and continue in this one."""
    folder = tmp_path / "sweep"
    process = subprocess.Popen([sys.executable, "-m", "omni_mj.cli.main", *sweep_command(folder)])
    deadline = time.monotonic() + 120
    while (
        len(list(folder.glob("shards/*.parquet"))) < 2
        and process.poll() is None
        and time.monotonic() < deadline
    ):
        time.sleep(0.002)
    process.kill()
    process.wait()
    assert len(list(folder.glob("shards/*.parquet"))) >= 2
    assert invoke(sweep_command(folder)) == 0
    assert capsys.readouterr() == ("", "")
    assert bits(pq.read_table(folder / "rows.parquet")) == bits(complete_sweep.rows())
    assert (folder / "sweep.png").stat().st_size > 10_000
    assert "kinematic.alpha_low" in (folder / "sweep.md").read_text()


NOTED = """
import os
import time
from pathlib import Path

import omni_mj as om


class Noted(om.Controller):  # waits in its first frame for a second process
    def command(self, frame, observation):
        Path(f"process-{os.getpid()}").touch()
        deadline = time.monotonic() + 20
        while frame == 0 and len([*Path().glob("process-*")]) < 2 and time.monotonic() < deadline:
            time.sleep(0.05)
        return -observation.pose
"""
PROGRAM = """
import omni_mj as om


class Mine(om.Controller):
    def command(self, frame, observation):
        return 0.0 * observation.pose


def sweep(controller):
    reference = {"waypoints": [[0, 0], [0.1, 0]]}
    rect = om.load_scenario("rect", plant="kinematic", reference=reference)
    try:
        result = om.sweep(rect, {"radio.delay_frames": [3, 4]}, [controller], out="map", jobs=2)
        print(result.rows().num_rows, "rows")
    except om.OmniError as error:
        print(error)


"""
GUARD = 'if __name__ == "__main__":\n    '


def test_processes_share_the_runs_of_one_shard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line says why a third process has nothing to do."""
    monkeypatch.chdir(tmp_path)
    Path("noted.py").write_text(NOTED)
    vary, names = {"radio.delay_frames": [0, 4]}, ["noted.py:Noted", "p"]
    with pytest.warns(UserWarning, match="only 2 of 3 processes run: a run with its controllers"):
        shared = bench.sweep(scenario(), vary, names, out="shared", jobs=3)
    assert len(shared.plan.shards) == 1
    assert len([*Path().glob("process-*")]) == 2
    assert bits(shared.rows()) == bits(bench.sweep(scenario(), vary, names, out="one").rows())


def test_programs_that_processes_cannot_import_are_refused_before_they_start(
    tmp_path: Path,
) -> None:
    """Cells, standard input, and calls outside of the guard; the last program is right."""
    in_function = "def f():\n    class Inner(Mine):\n        pass\n    sweep(Inner)\n"
    for name, call, message in (
        ("cell", "sweep(Mine)", "the class Mine cannot be sent to other processes: write it to a"),
        ("stdin", GUARD + "sweep('p')", "which is in no file: save it to a file, or use jobs=1"),
        ("script", "sweep('p')", "move the call in its line 20 into a block `if __name__"),
        ("local", f"{in_function}{GUARD}f()", "the class f.<locals>.Inner cannot be sent"),
        ("guarded", GUARD + "sweep(Mine)", "2 rows"),
    ):
        file = tmp_path / f"{name}.py"
        file.write_text(PROGRAM + call + "\n")
        program = {"cell": ["-c", file.read_text()], "stdin": ["-"]}.get(name, [str(file)])
        stdin = file.read_text() if name == "stdin" else ""
        done = run_python(program, input=stdin, cwd=tmp_path)
        assert (done.returncode, done.stderr) == (0, ""), name
        assert message in done.stdout
        assert done.stdout.count("\n") == 1
        assert (tmp_path / "map").exists() == (name == "guarded")


@pytest.fixture(scope="module")
def cluster() -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Provide the address of a scheduler, and two worker processes."""
    # Imported here because worker processes of the tests import this file
    from distributed import Client, LocalCluster

    options = "-m distributed.cli.dask_worker --no-nanny --nthreads 1 --no-dashboard"
    command = [sys.executable, *options.split()]
    local = LocalCluster(n_workers=0, dashboard_address=None, silence_logs=50)
    with local as scheduler:
        address = scheduler.scheduler_address
        processes = [
            subprocess.Popen([*command, address], stderr=subprocess.DEVNULL) for _ in range(2)
        ]
        with Client(address) as client:
            client.wait_for_workers(2, timeout=120)
        yield address, processes
        for process in processes:
            process.kill()
            process.wait()


def test_cluster_with_a_killed_worker_and_processes_give_the_same(
    complete_sweep: bench.SweepResult,
    cluster: tuple[str, list[subprocess.Popen[bytes]]],
    tmp_path: Path,
) -> None:
    """Kill a worker when two of twelve shards are done and others are running."""
    from distributed import Client

    frames = set()
    address, processes = cluster

    def kill_one(frame: int) -> None:
        frames.add(frame)
        if len(frames) == 3:
            processes[0].kill()

    with Client(address) as client:
        executor = client.get_executor(pure=False)
        result = run_sweep(
            tmp_path / "cluster",
            batch_size=2,
            executor=executor,
            start_progress=lambda title, n_frames: kill_one,
        )
    assert len(result.plan.shards) == 12
    assert frames == {count * result.plan.frames - 1 for count in range(13)}
    assert bits(result.rows()) == bits(complete_sweep.rows())
    assert bits(run_sweep(tmp_path / "jobs", batch_size=8, jobs=2).rows()) == bits(
        complete_sweep.rows()
    )
    assert invoke(sweep_command(tmp_path / "command"), "--cluster", address) == 0
    assert bits(pq.read_table(tmp_path / "command" / "rows.parquet")) == bits(complete_sweep.rows())


class OtherInstallation(Executor):
    """Runs each call in a new process with other source or environment."""

    def __init__(self, environment: dict[str, str]) -> None:
        self.environment = os.environ | environment

    def submit(self, function: Any, /, *arguments: Any, **_: Any) -> Future[Any]:
        code = "import pickle, sys; f, a = pickle.load(sys.stdin.buffer); f(*a)"
        call = pickle.dumps((function, arguments))
        done = run_python("-P -c", [code], input=call, env=self.environment, text=False)
        future: Future[Any] = Future()
        future.set_exception(RuntimeError(done.stderr.decode()))
        return future


def test_workers_with_another_source_or_arithmetic_are_refused(tmp_path: Path) -> None:
    root = Path(om.__file__).parents[1]
    for name in ("omni_mj", "models"):
        shutil.copytree(root / name, tmp_path / "other" / name)
    with (tmp_path / "other/omni_mj/config/rows.py").open("a") as file:
        file.write("# changed\n")
    for variable, value, difference in (
        ("PYTHONPATH", str(tmp_path / "other"), r"other versions.*: source \w+, not"),
        ("OPENBLAS_CORETYPE", "Nehalem", "another processor.*BLAS .*Nehalem, not"),
    ):
        with pytest.raises(om.OmniError, match=f"OmniError: .*{difference}"):
            run_sweep(tmp_path / "out", executor=OtherInstallation({variable: value}))


def test_clusters_and_packages_that_are_not_there_leave_no_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for cluster, message in (
        ("nonsense", "no Dask scheduler answers at nonsense"),
        ("tcp://127.0.0.1:9 --jobs 2", "cannot be used with --cluster"),
    ):
        assert invoke(sweep_command(tmp_path / "none"), "--cluster", cluster) == 2
        assert message in capsys.readouterr().err
    for package in ("distributed", "jax"):
        monkeypatch.setitem(sys.modules, package, None)  # as if it were not installed
    jax = "--plant planar --vary physics.backend=numpy,jax"
    for options in ("--cluster tcp://127.0.0.1:9", jax):
        assert invoke(sweep_command(tmp_path / "none"), options) == 2
        assert "which is not installed; install it with" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


def test_invalid_sweeps_are_rejected(tmp_path: Path) -> None:
    unused = tmp_path / "none"

    def refused(vary: Any, scenario: Any = "rect", seeds: Any = None, **options: Any) -> object:
        return bench.sweep(scenario, vary, NAMES, seeds, out=unused, **options)

    cases: tuple[tuple[Callable[[], object], str], ...] = (
        (lambda: refused({"carpet.fricton": [1]}), "unknown setting carpet.fricton"),
        (lambda: refused({"carpet.friction": []}), "1 to 1000 values"),
        (lambda: refused({"carpet.friction": [0.5, 0.5]}), "each once"),
        (lambda: refused({"carpet.friction": [0.5, 50.0]}), "carpet.friction must be"),
        (lambda: refused({"radio.delay_frames": range(4)}, LONG, range(1000), batch_size=8000),
         "GB are free; run fewer at a time"),
        (lambda: run_sweep(unused, jobs=0), "jobs must be at least 1, not 0"),
        (lambda: refused({}), "nothing varies"),
    )  # fmt: skip
    for call, message in cases:
        with pytest.raises(om.OmniError, match=message):
            call()
    assert not unused.exists()
    bench.sweep(scenario(), {"radio.delay_frames": [0]}, ["p"], out=tmp_path / "one")
    with pytest.raises(om.OmniError, match="holds another sweep"):
        bench.sweep(scenario(), {"radio.delay_frames": [1]}, ["p"], out=tmp_path / "one")


def test_axes_are_parsed() -> None:
    for text, values in (
        ("carpet.friction=0.3:1.0:8", [0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]),
        ("radio.delay_frames=0:12:4", [0, 4, 8, 12]),
        ("radio.delay_frames=0:10:4", [0, 3, 7, 10]),  # rounded
        ("radio.delay_frames=12:0:3", [12, 6, 0]),
        ("radio.delay_frames=0:1:2", [0, 1]),
        ("vision.cameras=1:3:3", [1, 2, 3]),
        ("carpet.friction=1:0.5:2", [1.0, 0.5]),
        ("radio.delay_frames=1,2,6", [1, 2, 6]),
        ("wheels.model=rollers,two-rollers", ["rollers", "two-rollers"]),
        ("carpet.friction=1,0.5", [1.0, 0.5]),
    ):
        assert bench.check_axes([bench.parse_axis(text)]) == {text.split("=")[0]: tuple(values)}
    for text, words in (
        ("carpet.friction=0.3:1.0", "LOW:HIGH:N or A,B,C"),
        ("carpet.friction=0.3:1.0:2:3", "LOW:HIGH:N or A,B,C"),
        ("carpet.friction=0.3:1.0:2.5", "LOW:HIGH:N or A,B,C"),
        ("carpet.friction=0.3:inf:3", "LOW:HIGH:N or A,B,C"),
        ("carpet.friction=0.3:1.0:1", "must be from 2 to 1000, got 1"),
        ("radio.delay_frames=0:12:0", "must be from 2 to 13, got 0"),
        ("radio.delay_frames=0:12:14", "must be from 2 to 13, got 14"),
        ("radio.delay_frames=0:1.5:2", "an integer"),
        ("firmware.thermal_derating=false:true:2", "is no number"),
        ("wheels.model=a:b:2", "is no number"),
        ("nothing.at_all=1:2:3", "unknown setting"),
    ):
        with pytest.raises(om.OmniError, match=words):
            bench.check_axes([bench.parse_axis(text)])


def test_wheel_models_do_not_share_a_shard() -> None:
    """On the MuJoCo plant a shard has one wheel model only."""
    vary = {"wheels.model": ["rollers", "two-rollers"], "carpet.friction": [0.5, 0.8]}
    plan = bench.SweepPlan(
        om.load_scenario("rect", controllers=["p"], seeds=2), bench.check_axes(vary.items()), 128
    )
    assert [len(shard.runs) for shard in plan.shards] == [4, 4]
    for shard in plan.shards:
        assert len({plan.points[point]["wheels.model"] for point, _ in shard.runs}) == 1


def test_correlations_and_worst_runs_are_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The dead time correlates, friction does not; a command repeats the worst run bit for bit.

    It has a truth value, a text and numbers, and a folder whose name needs quotes.
    """
    folder = tmp_path / "it's $1"
    options = "--scenario rect --plant kinematic --controller p --seeds 12 --out"
    delay = "--set radio.delay_frames={uniform=[0,8]} --vary firmware.thermal_derating=true"
    friction = "--set carpet.friction={uniform=[0.4,0.9]} --vary wheels.model=two-rollers"
    charge = "--vary battery.charge=0.5"
    assert invoke("sweep", options, folder, ROUTE, delay, friction, charge) == 0
    assert "radio.delay_frames" in capsys.readouterr().out
    summary = json.loads((folder / "summary.json").read_text())
    correlations = {line["setting"]: line["position_max_m"] for line in summary["correlations"]}
    assert correlations["radio.delay_frames"] > 0.9 > abs(correlations["carpet.friction"])
    rows = pq.read_table(folder / "rows.parquet").to_pylist()
    worst = summary["worst"][0]
    assert worst["position_max_m"] == max(row["position_max_m"] for row in rows)
    command = shlex.split(worst["repeat_command"])[1:]
    assert invoke(command, "--no-figures --no-record --out", tmp_path / "again") == 0
    summary = json.loads((tmp_path / "again/summary.json").read_text())
    again = summary["scenarios"]["rect"]["results"]["p"]
    assert again["error_m"]["position"]["max"]["per_seed"] == [worst["position_max_m"]]


class Failing(om.Controller):
    """Fails the later, the longer the dead time is; never with one of 9 frames."""

    def command(self, frame, observation):  # type: ignore[no-untyped-def]
        delay_frames = self.model.delay_frames
        if delay_frames < 9 and frame > 10 + delay_frames:
            raise ValueError("failed")
        return 0.0 * observation.pose


def test_worst_runs_are_the_earliest_failures(tmp_path: Path) -> None:
    result = bench.sweep(
        scenario(), {"radio.delay_frames": [9, 4, 2, 6]}, [Failing], out=tmp_path / "s"
    )
    worst = [run["radio.delay_frames"] for run in result.summary["worst"]]
    assert worst == [2, 4, 6]


def test_points_have_failure_rates_and_medians_with_intervals(
    complete_sweep: bench.SweepResult,
) -> None:
    """No failure of three robots has Wilson's interval 0 to 56 %; the median has no interval."""
    points = complete_sweep.summary["points"]
    assert [(c["point"], c["controller"]) for c in points] == [
        (i, name) for i in range(4) for name in NAMES
    ]
    for point in points:
        rows = [
            row
            for row in complete_sweep.rows().to_pylist()
            if all(row[key] == point[key] for key in ("point", "controller"))
        ]
        assert (point["n_robots"], point["n_failed"], point["failure_low"]) == (3, 0, 0.0)
        assert point["failure_high"] == pytest.approx(0.5615, abs=1e-4)
        errors = sorted(row["position_max_m"] for row in rows)
        assert point["position_max_m"] == {
            "median": errors[1],
            "low": None,
            "high": None,
            "p90": errors[2],
        }
