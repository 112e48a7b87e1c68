"""Files as nobody means them: values put in the place of others, anywhere in what a file holds."""

import json
import random
from collections.abc import Iterator
from typing import Any

ODD = (
    None, True, 0, -1, 1e308, -0.0, 10**400, "", "nan", "\x1b[31m\n\u2028", "../../x", "a" * 3000, [], {}, [[]], [None],
    {"": None}, {"file": "../x", "sha256": ""}, float("nan"), float("inf"),
)  # fmt: skip


def places(value: Any, where: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The ways to all that a value holds."""
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, each in parts:
        yield (*where, key)
        yield from places(each, (*where, key))


def mutated(value: Any, seed: int) -> Any:
    """A copy in which one to three things are something else, gone, or there under another name."""
    dice, copy = random.Random(seed), json.loads(json.dumps(value))
    for _ in range(dice.randint(1, 3)):
        ways = list(places(copy))
        if not ways:
            return copy
        *way, key = dice.choice(ways)
        holder = copy
        for each in way:
            holder = holder[each]
        what = dice.random()
        if what < 0.7:
            holder[key] = json.loads(json.dumps(dice.choice(ODD)))
        elif what < 0.9 or isinstance(holder, list):
            del holder[key]
        else:
            holder[dice.choice(("", "x\x07", "a" * 300))] = holder.pop(key)
    return copy
