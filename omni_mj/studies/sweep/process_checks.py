"""Check that other processes can import this program and the user's controllers.

A started process imports the main program. It ends with a traceback if it cannot, or if the program
then starts processes itself.
"""

import ast
import os
import pickle
import sys
from collections.abc import Iterable
from types import FrameType

from omni_control.errors import OmniError
from omni_mj.config.plugins import ControllerSpec

ADVICE = "or use jobs=1"


def check_program(controllers: Iterable[ControllerSpec]) -> None:
    """Check that other processes can import the main program and the controllers' classes.

    Raises:
        OmniError: They cannot.
    """
    file = getattr(sys.modules["__main__"], "__file__", None)
    imported_statements: list[ast.stmt] = []
    if file is not None:
        if not os.path.isfile(file):
            raise OmniError(
                "other processes cannot import this program, which is in no file: save it to a "
                f"file, {ADVICE}"
            )
        imported_statements = _list_imported_statements(file)
    line = _find_running_line(file)
    if any(node.lineno <= line <= (node.end_lineno or 0) for node in imported_statements):
        raise OmniError(
            f"other processes would import {file} and start processes themselves: move the call "
            f'in its line {line} into a block `if __name__ == "__main__":`, {ADVICE}'
        )
    for spec in controllers:
        if isinstance(spec, type) and not _is_importable(spec, imported_statements):
            raise OmniError(
                f"the class {spec.__qualname__} cannot be sent to other processes: write it to a "
                f"file, at the top level, and import it from there, {ADVICE}"
            )


def _list_imported_statements(file: str) -> list[ast.stmt]:
    """Return the statements of a program that run when it is imported; none if it is no source."""
    try:
        with open(file, "rb") as source:
            statements = ast.parse(source.read()).body
    except (SyntaxError, ValueError):
        return []
    return [node for node in statements if not _is_guarded(node)]


def _is_guarded(statement: ast.stmt) -> bool:
    """Return whether a statement depends on `__name__`, as `if __name__ == "__main__":` does."""
    names = (node.id for node in ast.walk(statement) if isinstance(node, ast.Name))
    return "__name__" in names


def _find_running_line(file: str | None) -> int:
    """Return the line of the main program that is running, or 0 if a line typed later is."""
    main_globals = vars(sys.modules["__main__"])
    line, frame = 0, sys._getframe()
    caller: FrameType | None = frame
    while caller is not None:
        is_module = caller.f_code.co_name == "<module>" and caller.f_globals is main_globals
        name = os.path.basename(caller.f_code.co_filename)
        if is_module and file is not None and name == os.path.basename(file):
            line = caller.f_lineno
        caller = caller.f_back
    return line


def _is_importable(controller: type, program: Iterable[ast.stmt]) -> bool:
    """Return whether another process can import a class, given the main program's statements."""
    try:
        pickle.dumps(controller)  # fails for a class in a function
    except (pickle.PicklingError, AttributeError, ImportError):
        return False
    module = controller.__module__
    if module == "__main__":
        nodes = (node for statement in program for node in ast.walk(statement))
        classes = (node.name for node in nodes if isinstance(node, ast.ClassDef))
        return controller.__qualname__.split(".")[0] in classes
    package = module.split(".")[0]
    return any(finder.find_spec(package, None) is not None for finder in sys.meta_path)
