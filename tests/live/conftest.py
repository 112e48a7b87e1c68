"""What serves robots waits for compiled loops: one process compiles them, for all."""

import compiled
import pytest


@pytest.fixture(scope="session", autouse=True)
def loops() -> None:
    compiled.once("mujoco")
