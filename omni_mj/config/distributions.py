"""Settings drawn per seed: a distribution in place of a value.

In scenario files, `friction = {uniform = [0.4, 0.9]}`, `{normal = [mean, deviation]}`,
`{normal = [mean, deviation, low, high]}` (truncated) or `{choice = [0.3, 0.5, 0.8]}` takes the
place of a number. In Python, it is such a dictionary. All controllers get the same values of a
seed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np

from omni_control.errors import OmniError, format_value
from omni_mj.config.settings import Settings, find_setting

PARAMETERS_BY_KIND = {  # kind of distribution -> description of its parameters, for messages
    "uniform": "[low, high], low below high",
    "normal": "[mean, deviation] or [mean, deviation, low, high], "
    "a deviation above 0 and low below high",
    "choice": "a list of 1 to 999 values",
}
# Allowed numbers of parameters by kind.
ALLOWED_LENGTHS = {"uniform": (2,), "normal": (2, 4), "choice": range(1, 1000)}
SettingValue = int | float | str | bool


@dataclass(frozen=True)
class Distribution:
    """The distribution of a setting.

    Attributes:
        kind: A key of `PARAMETERS_BY_KIND`.
        values: Parameters of the distribution, or the values to choose from.
        is_integer: Whether draws are integers. Uniform integers include both bounds.
    """

    kind: str
    values: tuple[Any, ...]
    is_integer: bool

    @property
    def median(self) -> SettingValue:
        """Nominal value of the setting: the median, or the first value of a choice."""
        if self.kind == "uniform":
            low, high = self.values
            return self._to_number((low + high) / 2)
        return self.values[0]

    @property
    def bounds(self) -> tuple[SettingValue, ...]:
        """Smallest and largest draw; all values of a choice; empty for an unbounded normal one."""
        return self.values[2:] if self.kind == "normal" else self.values

    @property
    def equally_likely_values(self) -> Sequence[SettingValue]:
        """All values of a discrete distribution; empty if it is continuous."""
        if self.kind == "uniform" and self.is_integer:
            return range(self.values[0], self.values[1] + 1)
        return self.values if self.kind == "choice" else ()

    def draw(self, random: np.random.Generator) -> SettingValue:
        """Return a random value."""
        if values := self.equally_likely_values:
            return values[int(random.integers(len(values)))]
        if self.kind == "normal" and not self.bounds:
            return self._to_number(float(random.normal(*self.values)))
        probability = random.uniform()
        if self.kind == "uniform":
            low, high = self.values
            return low + probability * (high - low)
        # Imported here, because scipy is slow to import and most runs do not need it.
        from scipy.special import ndtr, ndtri

        # Inverse transform of the truncated normal distribution, with p uniform in [0, 1):
        # x = mean + deviation * Phi^-1(Phi_low + p * (Phi_high - Phi_low))
        mean, deviation, low, high = self.values
        low_probability = ndtr((low - mean) / deviation)
        high_probability = ndtr((high - mean) / deviation)
        draw_probability = low_probability + probability * (high_probability - low_probability)
        return self._to_number(
            float(np.clip(mean + deviation * ndtri(draw_probability), low, high))
        )

    def _to_number(self, value: float) -> int | float:
        return round(value) if self.is_integer else float(value)


def split_distributions(
    sections: Mapping[str, Any],
) -> tuple[dict[str, Any], dict[str, Distribution]]:
    """Separate the distributions in sections of settings from values.

    Returns:
        The sections with `Distribution.median` in place of each distribution, and a mapping from
        `section.field` to distribution.

    Raises:
        OmniError: A setting cannot be drawn, or a distribution has wrong parameters.
    """
    nominal_sections = dict(sections)
    distributions: dict[str, Distribution] = {}
    for section, fields in sections.items():
        if section == "controller" or not isinstance(fields, Mapping):
            continue
        nominal_values = dict(fields)
        for field, value in fields.items():
            if isinstance(value, Mapping):
                distribution = _parse_distribution(f"{section}.{field}", value)
                distributions[f"{section}.{field}"] = distribution
                nominal_values[field] = distribution.median
        nominal_sections[section] = nominal_values
    return nominal_sections, distributions


def check_bounds(settings: Settings, distributions: Mapping[str, Distribution]) -> None:
    """Check that the settings allow all bounds of their distributions.

    Raises:
        OmniError: A bound is not allowed.
    """
    for name, distribution in distributions.items():
        for value in distribution.bounds:
            replace_values(settings, {name: value})


def draw_settings(
    settings: Settings, distributions: Mapping[str, Distribution], seed: int
) -> Settings:
    """Return the settings of a seed.

    Each setting has a random generator of its own, so its draws do not depend on other settings.

    Raises:
        OmniError: A draw from an unbounded distribution is not allowed.
    """
    if not distributions:
        return settings
    values = {}
    for name, distribution in sorted(distributions.items()):
        random = np.random.default_rng([seed, crc32(name.encode())])
        values[name] = distribution.draw(random)
    try:
        return replace_values(settings, values)
    except OmniError as error:
        raise OmniError(
            f"seed {seed} draws a value that is not allowed; give the distribution bounds: {error}"
        ) from None


def require_fixed_settings(distributions: Mapping[str, Distribution], study: str) -> None:
    """Check that no setting is drawn, for a study that needs one robot with fixed settings.

    Raises:
        OmniError: A setting is drawn.
    """
    if distributions:
        raise OmniError(
            f"{study} takes numbers, no distributions; give numbers for {', '.join(distributions)}"
        )


def replace_values(settings: Settings, values: Mapping[str, SettingValue]) -> Settings:
    """Return settings with changes, given as a mapping from `section.field` to value.

    Raises:
        OmniError: A value is not allowed.
    """
    sections: dict[str, dict[str, SettingValue]] = {}
    for name, value in values.items():
        section, field = name.split(".")
        sections.setdefault(section, {})[field] = value
    return settings.replace(**sections)


def _parse_distribution(name: str, fields: Mapping[str, Any]) -> Distribution:
    """Return the distribution of a setting.

    Args:
        name: Setting, `section.field`.
        fields: Kind -> parameters, such as `{"uniform": [0.4, 0.9]}`.

    Raises:
        OmniError: The setting cannot be drawn, or the kind or its parameters are not allowed.
    """
    setting = find_setting(name)
    kind, values = next(iter(fields.items()), ("", ()))
    if len(fields) != 1 or kind not in PARAMETERS_BY_KIND:
        value = format_value(dict(fields))
        raise OmniError(
            f"{name} must be a value, or one of {', '.join(PARAMETERS_BY_KIND)}, not {value}"
        )
    if setting.value_type is tuple:
        raise OmniError(f"{name} is a list, which cannot be drawn")
    if kind != "choice" and not setting.is_number:
        raise OmniError(f"{name} is not a number: draw it by {{choice = [...]}}, not {kind}")
    parameters = tuple(values) if isinstance(values, (list, tuple)) else ()
    if len(parameters) not in ALLOWED_LENGTHS[kind] or not _are_ordered(kind, parameters):
        raise OmniError(f"{name}: {kind} = {PARAMETERS_BY_KIND[kind]}, not {format_value(values)}")
    # Settings check that integers are not drawn between fractions.
    is_integer = setting.value_type is int and not any(type(x) is float for x in parameters)
    return Distribution(kind, parameters, is_integer)


def _are_ordered(kind: str, parameters: Sequence[Any]) -> bool:
    """Return whether parameters are numbers, low is below high, and a deviation is positive."""
    if kind == "choice":
        return True
    if not all(isinstance(number, (int, float)) for number in parameters):
        return False
    # normal: 0 < deviation, and low < high if they are given
    ascending_pairs = parameters if kind == "uniform" else (0, *parameters[1:])
    return bool(np.all(np.diff(np.reshape(ascending_pairs, (-1, 2))) > 0))
