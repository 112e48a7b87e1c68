"""Controllers by name, class or file: found, and named in tables and files."""

from pathlib import Path

import pytest

from omni_control.errors import OmniError
from omni_mj.scenarios import controllers, scenario

MINE = '''
from omni_control.controllers.base import Controller


class MyTracker(Controller):
    """Of a user."""


class Stranger:
    """No controller."""
'''


@pytest.fixture
def user(tmp_path: Path) -> Path:
    """A folder with a file of controllers in it."""
    (tmp_path / "mine.py").write_text(MINE)
    return tmp_path


# --- bad input: (what the file holds, or None for no file; the name given; what the message says) ---

LINES = MINE.count("\n")
BAD_INPUT = {
    "misspelt class": (MINE, "mine.py:MyTraker", ["MyTraker", "did you mean 'MyTracker'"]),
    "missing file": (None, "mine.py:MyTracker", ["no file", "mine.py"]),
    "no class": (MINE, "mine.py", ["file.py:Class"]),
    "no Python file": (MINE, "mine.txt:MyTracker", ["mine.txt:MyTracker", "file.py:Class"]),
    "syntax error": (MINE + "def f(:\n", "mine.py:MyTracker", ["mine.py", "SyntaxError", f"line {LINES + 1}"]),
    "error on import": (MINE + "import absent\n", "mine.py:MyTracker", ["mine.py", "ModuleNotFoundError", "absent"]),
    "error of lines": (MINE + "raise ValueError('a\\nb')\n", "mine.py:MyTracker", ["ValueError: a b"]),
    "not a tracker": (MINE, "mine.py:Stranger", ["Stranger", "derived from omni_control.Controller", "MyTracker"]),
    "no tracker at all": ("Controller = 3\n", "mine.py:Controller", ["'Controller'", "no other"]),
    "somebody else's tracker": (MINE, "mine.py:Controller", ["'Controller'", "choose from MyTracker"]),
}  # fmt: skip


@pytest.mark.parametrize("mistake", BAD_INPUT)
def test_bad_input_is_one_line_that_says_what_is_wrong(tmp_path: Path, mistake: str) -> None:
    source, name, says = BAD_INPUT[mistake]
    if source is not None:
        (tmp_path / "mine.py").write_text(source)
    with pytest.raises(OmniError) as error:
        scenario.scenario("rect", controllers=["flc", f"{tmp_path / name}"])
    assert [words for words in says if words not in str(error.value)] == []
    assert "\n" not in str(error.value)


def test_labels_are_names_or_classes() -> None:
    assert [controllers.label(name) for name in ("comp-flc", "a/b.py:Mine")] == ["comp-flc", "Mine"]


def test_two_controllers_of_one_name_are_refused(user: Path) -> None:
    """Tables and files could not tell them apart."""
    (user / "other.py").write_text(MINE)
    names = [f"{user / file}:MyTracker" for file in ("mine.py", "other.py")]
    with pytest.raises(OmniError, match="named twice"):
        scenario.load("rect", (), {"controllers": names})


def test_a_file_is_run_once_until_it_changes(user: Path) -> None:
    name = f"{user / 'mine.py'}:MyTracker"
    first = controllers.find(name)
    assert controllers.find(name) is first
    assert controllers.find(first) is first
    (user / "mine.py").write_text(MINE.replace("Of a user", "Changed by a user"))
    assert controllers.find(name).__doc__ == "Changed by a user."
