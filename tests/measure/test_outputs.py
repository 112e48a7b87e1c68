"""What a run leaves behind: summary, table and figures agree with each other."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from matplotlib.image import imread

SEEDS = 3


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the default scenario with three seeds."""
    path = tmp_path_factory.mktemp("run")
    command = [sys.executable, "-m", "omni_mj.run", "--scenario", "rect", "--seeds", str(SEEDS), "--quiet", "--out"]
    subprocess.run([*command, str(path)], check=True, timeout=300)
    return path


@pytest.fixture(scope="module")
def summary(folder: Path) -> Any:
    return json.loads((folder / "summary.json").read_text())


@pytest.fixture(scope="module")
def table(folder: Path) -> pa.Table:
    return pq.read_table(folder / "trajectory.parquet")


def rows(table: pa.Table, controller: str, seed: int) -> dict[str, np.ndarray]:
    mask = pa.compute.and_(
        pa.compute.equal(table["controller"].cast(pa.string()), controller), pa.compute.equal(table["seed"], seed)
    )
    chosen = table.filter(mask).sort_by("frame")
    return {name: chosen[name].to_numpy() for name in table.column_names if name != "controller"}


def test_columns_are_those_that_users_rely_on(table: pa.Table) -> None:
    promised = [
        "controller",
        "seed",
        "frame",
        "time_s",
        "ref_x_m",
        "ref_y_m",
        "ref_heading_rad",
        "x_m",
        "y_m",
        "heading_rad",
        "vision_x_m",
        "vision_y_m",
        "vision_heading_rad",
        "vision_valid",
        "predicted_x_m",
        "predicted_y_m",
        "predicted_heading_rad",
        "command_vx_m_s",
        "command_vy_m_s",
        "command_w_rad_s",
        "applied_vx_m_s",
        "applied_vy_m_s",
        "applied_w_rad_s",
        "alpha_hat_x",
        "alpha_hat_y",
        "alpha_hat_heading",
        "latency_hat_forward_frames",
        "latency_hat_left_frames",
        "latency_hat_turn_frames",
    ]
    promised += [
        f"{c}_{i}_{u}" for c, u in (("wheel_speed", "rad_s"), ("voltage", "v"), ("current", "a")) for i in "1234"
    ]
    assert set(promised) <= set(table.column_names)
    assert table.num_rows == 2 * SEEDS * table["frame"].to_numpy().max() + 2 * SEEDS


def test_every_error_of_the_summary_follows_from_the_table(summary: Any, table: pa.Table) -> None:
    for controller in ("flc", "comp-flc"):
        for axis in "xy":
            errors = [rows(table, controller, seed) for seed in summary["seeds"]]
            absolute = [np.abs(r[f"{axis}_m"] - r[f"ref_{axis}_m"]) for r in errors]
            reported = summary["results"][controller]["error_m"][axis]
            laws = {"max": np.max, "mean": np.mean, "rms": lambda e: np.sqrt(np.mean(np.square(e)))}
            for name, law in laws.items():
                values = [law(e) for e in absolute]
                # Both are the same sums in another order: equal to rounding.
                expected = [np.median(values), min(values), max(values)]
                assert list(reported[name].values()) == pytest.approx(expected, rel=1e-12)


def test_alpha_and_peaks_of_the_summary_follow_from_the_table(summary: Any, table: pa.Table) -> None:
    n = 15
    for controller in ("flc", "comp-flc"):
        result = summary["results"][controller]
        runs = [rows(table, controller, seed) for seed in summary["seeds"]]
        for axis in "xy":
            ratios = []
            for r in runs:
                for k in range(len(r["frame"]) - n):
                    commanded = r[f"applied_v{axis}_m_s"][k : k + n].mean()
                    if abs(commanded) > 0.1:
                        ratios.append((r[f"{axis}_m"][k + n] - r[f"{axis}_m"][k]) / (commanded * n / 60))
            expected = np.percentile(ratios, [5, 50, 95])
            # The library accumulates sums over the run where this averages windows: rounding, near 1e-12.
            assert list(result["alpha"][axis].values()) == pytest.approx(list(expected), rel=1e-9)
        assert result["peak_voltage_v"] == max(r["voltage_peak_v"].max() for r in runs)
        assert result["peak_current_a"] == max(r["current_peak_a"].max() for r in runs)
        assert result["peak_voltage_v"] >= max(np.abs(r[f"voltage_{i}_v"]).max() for r in runs for i in "1234")


def test_the_compensator_keeps_the_promise_of_the_paper(summary: Any) -> None:
    """At least the paper's reductions of the maximum error, to at most its figures (table 3)."""
    error = summary["results"]["comp-flc"]["error_m"]
    reduction = summary["results"]["comp-flc"]["reduction_percent"]
    assert reduction["x"]["max"] >= 35
    assert reduction["y"]["max"] >= 49
    assert error["x"]["max"]["median"] <= 0.021
    assert error["y"]["max"]["median"] <= 0.039
    assert summary["paper"]["comp-flc"]["x"]["max"] == 0.02124


def test_nothing_is_wrong_in_the_summary_itself(summary: Any) -> None:
    assert summary["complete"]
    assert summary["seeds"] == [0, 1, 2]
    assert summary["simulated_s"] == pytest.approx(summary["frames"] / 60)
    assert summary["settings"]["radio"]["delay_frames"] == 6
    assert {"python", "omni-mj", "mujoco"} <= set(summary["versions"])


@pytest.mark.parametrize("name", ["path", "output", "error"])
def test_figures_show_both_controllers(folder: Path, name: str) -> None:
    pixels = (255 * imread(folder / "figures" / f"{name}.png")[..., :3]).round().astype(int)
    for colour in ((0xD5, 0x5E, 0x00), (0x00, 0x72, 0xB2)):
        # A line across the figure covers hundreds of pixels in its pure colour.
        assert (np.abs(pixels - colour).sum(-1) < 6).sum() > 200
