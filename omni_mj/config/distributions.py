"""Settings that are drawn: a distribution in place of a number, from which each seed has its own.

In a scenario's file, and alike in Python: `friction = {uniform = [0.4, 0.9]}`, `{normal = [mean, deviation]}`,
`{normal = [mean, deviation, low, high]}` (truncated), `{choice = [0.3, 0.5, 0.8]}`. All controllers draw the same.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np

from omni_control.errors import OmniError, suggest_names
from omni_mj.config.settings import Settings, list_settings
from omni_mj.config.validation import format_value

KINDS = {
    "uniform": "[low, high], low below high",
    "normal": "[mean, deviation] or [mean, deviation, low, high], a deviation above 0 and low below high",
    "choice": "a list of 1 to 999 values",
}
LENGTHS = {"uniform": (2,), "normal": (2, 4), "choice": range(1, 1000)}
Value = int | float | str | bool


@dataclass(frozen=True)
class Distribution:
    """The distribution from which a setting is drawn.

    Args:
        kind: A name of `KINDS`.
        values: Its numbers, or the values to choose from.
        whole: Whether draws are whole numbers; a uniform one then reaches both of its ends.
    """

    kind: str
    values: tuple[Any, ...]
    whole: bool = False

    @property
    def middle(self) -> Value:
        """Its median; of a choice the first value. It stands in the settings of the scenario itself."""
        first = self.values[0]
        return self._number((first + self.values[1]) / 2) if self.kind == "uniform" else first

    @property
    def ends(self) -> tuple[Value, ...]:
        """Smallest and largest draw, or all values of a choice; empty if there is no end."""
        return self.values[2:] if self.kind == "normal" else self.values

    @property
    def options(self) -> Sequence[Value]:
        """The values of a discrete one, each of the same share; empty if it is continuous."""
        if self.kind == "uniform" and self.whole:
            return range(self.values[0], self.values[1] + 1)
        return self.values if self.kind == "choice" else ()

    def draw(self, random: np.random.Generator) -> Value:
        """Draw a value."""
        if self.options:
            return self.options[int(random.integers(len(self.options)))]
        if self.kind == "normal" and not self.ends:
            return self._number(float(random.normal(*self.values)))
        share = random.uniform()
        if self.kind == "uniform":
            low, high = self.values
            return float(low + share * (high - low))
        from scipy.special import ndtr, ndtri  # imported late: lists and schemas do without

        mean, deviation, *ends = self.values
        a, b = (ndtr((end - mean) / deviation) for end in ends)
        return self._number(float(np.clip(mean + deviation * ndtri(a + share * (b - a)), *ends)))

    def _number(self, value: float) -> int | float:
        return round(value) if self.whole else float(value)


def split_distributions(
    sections: Mapping[str, Any],
) -> tuple[dict[str, Any], dict[str, Distribution]]:
    """Return sections with each distribution's middle in its place, and the distributions by `section.field`.

    Raises:
        OmniError: A distribution of what cannot be drawn, or one with wrong numbers.
    """
    plain, drawn = dict(sections), dict[str, Distribution]()
    for section, fields in sections.items():
        if section != "controller" and isinstance(fields, Mapping):
            own = {
                f"{section}.{field}": value
                for field, value in fields.items()
                if isinstance(value, Mapping)
            }
            drawn |= {name: _made(name, value) for name, value in own.items()}
            plain[section] = {**fields, **{name.split(".")[1]: drawn[name].middle for name in own}}
    return plain, drawn


def check_bounds(settings: Settings, drawn: Mapping[str, Distribution]) -> None:
    """Check that all ends of distributions are allowed.

    Raises:
        OmniError: One is not.
    """
    for name, distribution in drawn.items():
        for end in distribution.ends:
            replace_values(settings, {name: end})


def draw_settings(
    settings: Settings, distributions: Mapping[str, Distribution], seed: int
) -> Settings:
    """Return the settings that a seed draws; a setting's draws do not depend on which others are drawn.

    Raises:
        OmniError: A draw is not allowed, of a distribution without ends.
    """
    if not distributions:
        return settings
    values = {
        name: each.draw(np.random.default_rng([seed, crc32(name.encode())]))
        for name, each in sorted(distributions.items())
    }
    try:
        return replace_values(settings, values)
    except OmniError as error:
        raise OmniError(
            f"seed {seed} draws what is not allowed; give the distribution ends: {error}"
        ) from None


def require_fixed_settings(distributions: Mapping[str, Distribution], study: str) -> None:
    """Check that nothing is drawn, where a study takes one robot with settings of its own.

    Raises:
        OmniError: Something is.
    """
    if distributions:
        raise OmniError(
            f"{study} takes numbers, no distributions; give one for {', '.join(distributions)}"
        )


def replace_values(settings: Settings, values: Mapping[str, Value]) -> Settings:
    """Return the settings with other values, by `section.field`.

    Raises:
        OmniError: A value is not allowed.
    """
    sections: dict[str, dict[str, Value]] = {}
    for name, new in values.items():
        section, field = name.split(".")
        sections.setdefault(section, {})[field] = new
    return settings.replace(**sections)


def _made(name: str, given: Mapping[str, Any]) -> Distribution:
    known = {each.full: each for each in list_settings()}
    if name not in known:
        raise OmniError(f"unknown setting {name}; {suggest_names(name, known)}")
    kind, values = next(iter(given.items()), ("", ()))
    if len(given) != 1 or kind not in KINDS:
        raise OmniError(
            f"{name} must be a value, or one of {', '.join(KINDS)}, not {format_value(dict(given))}"
        )
    if known[name].kind is tuple:
        raise OmniError(f"{name} is a list, which cannot be drawn")
    if kind != "choice" and not known[name].number:
        raise OmniError(f"{name} is no number: draw it by {{choice = [...]}}, not {kind}")
    numbers = tuple(values) if isinstance(values, (list, tuple)) else ()
    fits = len(numbers) in LENGTHS[kind]
    if fits and kind != "choice":
        pairs = numbers if kind == "uniform" else (0, *numbers[1:])  # ascending each
        fits = all(isinstance(number, (int, float)) for number in numbers)
        fits = fits and bool(np.all(np.diff(np.reshape(pairs, (-1, 2))) > 0))
    if not fits:
        raise OmniError(f"{name}: {kind} = {KINDS[kind]}, not {format_value(values)}")
    return Distribution(kind, numbers, known[name].kind is int)
