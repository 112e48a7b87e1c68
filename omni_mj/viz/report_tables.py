"""Tables that only the report shows: motors and settings."""

import json
from collections.abc import Mapping
from typing import Any

from omni_mj.config.settings import list_settings
from omni_mj.results.result_tables import DASH, Table, drop_equal_columns, format_number
from omni_mj.results.saturation import METRIC_LABELS

PEAKS = {"peak_voltage_v": "peak, V", "peak_current_a": "peak, A"}
ALPHA = ("alpha x", "alpha y")
TEMPERATURE = "peak_winding_temperature_c"
MIN_HEATING_K = 10.0  # rise of a winding's temperature from which the table shows it
Summary = Mapping[str, Any]


def motor_table(entry: Summary) -> Table:
    """Return effort, limits reached, peaks of the motors and alpha of each controller."""
    ambient_c = entry["settings"]["motor"]["ambient_c"]
    temperatures = [result[TEMPERATURE] for result in entry["results"].values()]
    is_hot = any(value is not None and value > ambient_c + MIN_HEATING_K for value in temperatures)
    peaks = PEAKS | ({TEMPERATURE: "winding, °C"} if is_hot else {})
    limits = [f"{label}, %" for label in METRIC_LABELS.values()]
    headings = ["controller", "effort, m/s²", *limits, *peaks.values(), *ALPHA]
    rows = []
    for controller, result in entry["results"].items():
        fractions = [result["saturation"][name]["median"] for name in METRIC_LABELS]
        alphas = [(result["alpha"] or {}).get(axis, {}).values() for axis in "xy"]
        rows.append(
            [
                controller,
                format_number(result["effort_m_s2"]["median"]),
                *(format_number(fraction, 100, 1) for fraction in fractions),
                *(format_number(result[name]) for name in peaks),
                *("/".join(map(format_number, percentiles)) for percentiles in alphas),
            ]
        )
    title = (
        "Effort; percentage of the frames in which a limit is reached, and mean duty cycle; peaks "
        "of all motors and seeds; 5th/50th/95th percentile of alpha in windows of 0.25 s (the paper"
        " reports 0.7 to 1)"
    )
    return drop_equal_columns(Table(title, headings, rows, 1), kept_headings=ALPHA)


def settings_table(entries: Mapping[str, Summary]) -> Table:
    """Return the settings in which scenarios differ, or those of one that are not the default."""
    columns = {name: _flatten_settings(entry) for name, entry in entries.items()}
    if len(entries) == 1:
        title = "Settings that differ from their default"
        (settings,) = columns.values()
        defaults = {setting.full_name: setting.default for setting in list_settings()}
        # A setting without a default depends on the robot, whose value counts as the default.
        for name, default in defaults.items():
            if default is None:
                defaults[name] = settings.get(name)
        columns = {"default": defaults} | columns
    else:
        title = "Settings in which they differ"
        for name, entry in entries.items():
            columns[name] |= {"plant": entry["plant"], "robot": entry["robot"]}
    names = dict.fromkeys(name for values in columns.values() for name in values)
    rows = []
    for name in names:
        values = [_to_json_types(column.get(name)) for column in columns.values()]
        if any(value != values[0] for value in values):
            rows.append([name, *map(format_setting, values)])
    return Table(title, ["setting", *columns], rows, 1 + len(columns))


def format_setting(value: Any) -> str:
    """Return a setting's value as in a scenario file but without quotes, or a dash if None."""
    if value is None:
        return DASH
    return value if isinstance(value, str) else json.dumps(value)


def _to_json_types(value: Any) -> Any:
    """Return a value as it is read from a file, so that values from files and code compare."""
    return json.loads(json.dumps(value))


def _flatten_settings(entry: Summary) -> dict[str, Any]:
    """Return settings by full name; faults and each controller's parameters are one value."""
    values: dict[str, Any] = {}
    for section, fields in entry["settings"].items():
        if isinstance(fields, dict):
            values |= {f"{section}.{name}": value for name, value in fields.items()}
        elif fields:
            values[section] = fields
    return values
