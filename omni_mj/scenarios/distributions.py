"""Settings that are drawn: a distribution in place of a number, from which each seed has its own.

In a scenario's file, and alike in Python: `friction = {uniform = [0.4, 0.9]}`, `{normal = [mean, deviation]}`,
`{normal = [mean, deviation, low, high]}` (truncated), `{choice = [0.3, 0.5, 0.8]}`. All controllers draw the same.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np

from omni_control.errors import OmniError, choose
from omni_mj.scenarios.checking import Checked, shown
from omni_mj.scenarios.settings import Settings, every_setting

KINDS = {"uniform": (2,), "normal": (2, 4), "choice": range(1, 1000)}
_WRITTEN = {
    "uniform": "[low, high]",
    "normal": "[mean, deviation], or [mean, deviation, low, high]",
    "choice": "a list of what there is to choose from",
}
Value = int | float | str | bool


@dataclass(frozen=True)
class Distribution:
    """What a setting is drawn from.

    Args:
        kind: a name of `KINDS`.
        values: its numbers, or what there is to choose from.
        whole: whether draws are whole numbers; a uniform one then reaches both of its ends.
    """

    kind: str
    values: tuple[Any, ...]
    whole: bool = False

    @property
    def middle(self) -> Value:
        """Its median; of a choice the first. What settings hold where one number must stand for it."""
        first = self.values[0]
        return self._number((first + self.values[1]) / 2) if self.kind == "uniform" else first

    @property
    def ends(self) -> tuple[Value, ...]:
        """What all draws lie between, or all there are to choose from; none where there is no end."""
        return {"uniform": self.values, "normal": self.values[2:], "choice": self.values}[self.kind]

    @property
    def plain(self) -> dict[str, list[Any]]:
        """As it stands in a file."""
        return {self.kind: list(self.values)}

    def draw(self, random: np.random.Generator) -> Value:
        """A value."""
        if self.kind == "choice":
            return self.values[int(random.integers(len(self.values)))]
        if self.kind == "uniform":
            low, high = self.values
            return int(random.integers(low, high + 1)) if self.whole else float(random.uniform(low, high))
        mean, deviation, *ends = self.values
        if not ends:
            return self._number(float(random.normal(mean, deviation)))
        return self.quantile(random.uniform())

    def quantile(self, share: float) -> Value:
        """The value below which a share of all draws lies; of whole numbers and choices, each has as much of it."""
        if self.kind == "choice" or (self.kind == "uniform" and self.whole):
            all_there = self.values if self.kind == "choice" else range(self.values[0], self.values[1] + 1)
            return all_there[min(int(share * len(all_there)), len(all_there) - 1)]
        if self.kind == "uniform":
            low, high = self.values
            return float(low + share * (high - low))
        from scipy.special import ndtr, ndtri  # late: lists and schemas are made without

        mean, deviation, *ends = self.values
        a, b = (ndtr((end - mean) / deviation) for end in ends) if ends else (0.0, 1.0)
        value = mean + deviation * ndtri(a + share * (b - a))  # by the inverse of its distribution function
        return self._number(float(np.clip(value, *ends) if ends else value))

    def _number(self, value: float) -> int | float:
        return round(value) if self.whole else float(value)


def split(sections: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Distribution]]:
    """Sections of settings with each distribution's middle in its place, and the distributions by `section.field`.

    Raises:
        OmniError: a distribution of what cannot be drawn, or one with wrong numbers.
    """
    plain, found = dict(sections), dict[str, Distribution]()
    for section, field, value in _there(sections):
        made = found[f"{section}.{field}"] = _made(f"{section}.{field}", value)
        plain[section] = {**plain[section], field: made.middle}
    return plain, found


def written(sections: dict[str, Any], found: Mapping[str, Distribution]) -> dict[str, Any]:
    """Sections of plain settings, with the distributions in their places: what `split` took apart."""
    for name, each in found.items():
        section, field = name.split(".")
        sections[section][field] = each.plain
    return sections


def check(settings: Settings, found: Mapping[str, Distribution]) -> None:
    """See that all that may be drawn is allowed.

    Raises:
        OmniError: the end of a distribution, or what may be chosen, is not.
    """
    for name, distribution in found.items():
        for end in distribution.ends:
            _with(settings, {name: end})


def drawn(settings: Settings, found: Mapping[str, Distribution], seed: int) -> Settings:
    """The settings with what a seed draws; a setting's draws do not depend on which others are drawn.

    Raises:
        OmniError: a draw is not allowed, of a distribution without ends.
    """
    if not found:
        return settings
    values = {
        name: each.draw(np.random.default_rng([seed, crc32(name.encode())])) for name, each in sorted(found.items())
    }
    try:
        return _with(settings, values)
    except OmniError as error:
        raise OmniError(f"seed {seed} draws what is not allowed; give the distribution ends: {error}") from None


def refuse(found: Mapping[str, Distribution], study: str) -> None:
    """See that nothing is drawn, where a study takes one robot with settings of its own.

    Raises:
        OmniError: something is.
    """
    if found:
        raise OmniError(f"{study} takes numbers, no distributions; give one for {', '.join(found)}")


def value(settings: Settings, name: str) -> Value:
    """The value of the setting called `section.field`."""
    section, field = name.split(".")
    return getattr(settings, section).values()[field]


def _with(settings: Settings, values: Mapping[str, Value]) -> Settings:
    sections: dict[str, dict[str, Value]] = {}
    for name, value in values.items():
        section, field = name.split(".")
        sections.setdefault(section, {})[field] = value
    return settings.replace(**sections)


def _there(sections: Mapping[str, Any]) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Section, field and value of what looks like a distribution."""
    for section, fields in sections.items():
        if isinstance(fields, Mapping) and not isinstance(fields, Checked) and section != "controller":
            for field, value in fields.items():
                if isinstance(value, Mapping):
                    yield section, field, value


def _made(name: str, value: Mapping[str, Any]) -> Distribution:
    kinds = list(value)
    declared = next((each for each in every_setting() if each.full == name), None)
    if declared is None:
        raise OmniError(f"unknown setting {name}; {choose(name, [each.full for each in every_setting()])}")
    if len(kinds) != 1 or kinds[0] not in KINDS:
        raise OmniError(f"{name} must be {declared.wanted}, or one of {', '.join(KINDS)}, not {shown(dict(value))}")
    kind, numbers = kinds[0], value[kinds[0]]
    if kind != "choice" and not declared.number:
        raise OmniError(f"{name} is no number: draw it by {{choice = [...]}}, not {kind}")
    if not isinstance(numbers, (list, tuple)) or len(numbers) not in KINDS[kind]:
        raise OmniError(f"{name}: {kind} = {_WRITTEN[kind]}, not {shown(numbers)}")
    if kind != "choice":
        if not all(isinstance(each, (int, float)) and np.isfinite(each) for each in numbers):
            raise OmniError(f"{name}: {kind} = {_WRITTEN[kind]}, all numbers, not {shown(numbers)}")
        if (kind == "uniform" and numbers[0] > numbers[1]) or (len(numbers) == 4 and numbers[2] >= numbers[3]):
            raise OmniError(f"{name}: {kind} = {_WRITTEN[kind]} with low below high, not {shown(numbers)}")
        if kind == "normal" and numbers[1] <= 0:
            raise OmniError(f"{name}: normal = {_WRITTEN[kind]} with a deviation above 0, not {shown(numbers)}")
    return Distribution(kind, tuple(numbers), declared.kind is int)
