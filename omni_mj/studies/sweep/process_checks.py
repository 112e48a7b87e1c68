"""Check that other processes can import this program and the user's controllers.

A started process imports the main program. It ends with a traceback if it cannot, or if the program
then starts processes itself.
"""

import ast
import os
import pickle
import sys
import traceback
from collections.abc import Iterable

from omni_control.errors import OmniError
from omni_mj.config.plugins import ControllerSpec

ADVICE = "or use jobs=1"


def check_program(controllers: Iterable[ControllerSpec]) -> None:
    """Check that other processes can import the main program and the controllers' classes.

    Raises:
        OmniError: They cannot.
    """
    main = sys.modules["__main__"]
    file = getattr(main, "__file__", None)
    if file is not None and not os.path.isfile(file):
        raise OmniError(
            f"other processes cannot import this program, which is in no file: save it to a file, "
            f"{ADVICE}"
        )
    statements = _list_imported_statements(file) if file else []
    for frame, line in traceback.walk_stack(None):
        code = frame.f_code
        is_main = frame.f_globals is vars(main) and code.co_name == "<module>"
        # Lines that are typed after the program's end come from <stdin>.
        if not is_main or code.co_filename.startswith("<"):
            continue
        if any(node.lineno <= line <= (node.end_lineno or 0) for node in statements):
            raise OmniError(
                f"other processes would import {file} and start processes themselves: move the "
                f'call in its line {line} into a block `if __name__ == "__main__":`, {ADVICE}'
            )
    for spec in controllers:
        if isinstance(spec, type) and not _is_importable(spec, statements):
            raise OmniError(
                f"the class {spec.__qualname__} cannot be sent to other processes: write it to a "
                f"file, at the top level, and import it from there, {ADVICE}"
            )


def _list_imported_statements(file: str) -> list[ast.stmt]:
    """Return the statements of a program that run when it is imported; none if it is no source.

    Those that depend on `__name__`, as `if __name__ == "__main__":` does, are left out.
    """
    try:
        with open(file, "rb") as source:
            statements = ast.parse(source.read()).body
    except (SyntaxError, ValueError):
        return []
    return [
        statement
        for statement in statements
        if all(getattr(node, "id", "") != "__name__" for node in ast.walk(statement))
    ]


def _is_importable(controller: type, statements: Iterable[ast.stmt]) -> bool:
    """Return whether another process that runs these statements can import a class."""
    try:
        pickle.dumps(controller)  # fails for a class in a function
    except (pickle.PicklingError, AttributeError, ImportError):
        return False
    return controller.__module__ != "__main__" or any(
        isinstance(node, ast.ClassDef) and node.name == controller.__name__
        for statement in statements
        for node in ast.walk(statement)
    )
