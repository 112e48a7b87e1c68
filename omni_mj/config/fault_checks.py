"""Parse the faults of a scenario, and check them against its settings and plant."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from omni_control.errors import OmniError, format_value, suggest_names
from omni_mj.config.faults import FAULT_KINDS, Fault, RadioDelay, WheelFault
from omni_mj.config.plugins import PLANTS, find_plant
from omni_mj.config.validation import collect_errors, raise_errors

if TYPE_CHECKING:
    from omni_mj.config.settings import Settings


def parse_faults(fault_list: Any) -> tuple[Fault, ...]:
    """Return the faults described by the list `fault` of a scenario.

    Args:
        fault_list: List of faults, or of mappings with a kind and its fields.

    Raises:
        OmniError: There is no such kind, or a value is not allowed. The message has one line per
            error.
        ValueError: The faults are not a list.
    """
    if not isinstance(fault_list, (list, tuple)):
        value = format_value(fault_list)
        raise ValueError(f"fault is a list: write [[fault]] and its fields below, not {value}")
    faults: list[Fault] = []
    errors: list[str] = []
    for number, fault in enumerate(fault_list, 1):
        with collect_errors(errors, f"fault {number}: "):
            faults.append(fault if isinstance(fault, Fault) else _parse_fault(fault))
    raise_errors(errors)
    return tuple(faults)


def find_fault_contradictions(faults: Iterable[Fault], settings: "Settings") -> Iterator[str]:
    """Yield a message for each fault that is impossible with these settings."""
    n_wheels = len(settings.wheels.azimuths_deg)
    jitter_frames = settings.radio.jitter_frames
    for number, fault in enumerate(faults, 1):
        prefix = f"fault {number}: {fault.kind}"
        if isinstance(fault, WheelFault) and fault.wheel > n_wheels:
            yield (
                f"{prefix}: wheel must be 1 to {n_wheels}, not {fault.wheel}: "
                f"the robot has {n_wheels} wheels"
            )
        if isinstance(fault, RadioDelay) and fault.delay_frames < jitter_frames:
            yield (
                f"{prefix}: delay_frames must be at least radio.jitter_frames, {jitter_frames}, "
                f"not {fault.delay_frames}"
            )


def list_supported_kinds(plant: str) -> list[str]:
    """Return the kinds of faults that a plant supports.

    A custom plant lists the kinds that it supports in its attribute `faults`.

    Raises:
        OmniError: There is no such plant.
    """
    custom_kinds = () if plant in PLANTS else getattr(find_plant(plant), "faults", ())
    return [
        name
        for name, fault_class in FAULT_KINDS.items()
        if fault_class.plants is None or plant in fault_class.plants or name in custom_kinds
    ]


def check_plant_supports(faults: Sequence[Fault], plant: str, n_robots: int | None = None) -> None:
    """Check that a plant supports all faults, and that its worlds have the affected robots.

    Args:
        faults: Faults of a scenario.
        plant: Name of the plant.
        n_robots: Number of robots in a world. Default: unknown, so robots are not checked.

    Raises:
        OmniError: A check fails. The message has one line per error.
    """
    supported_kinds = list_supported_kinds(plant) if faults else []
    errors = []
    for number, fault in enumerate(faults, 1):
        if fault.kind not in supported_kinds:
            errors.append(
                f"fault {number}: the plant {plant} has no {fault.kind}; "
                f"it has {', '.join(supported_kinds)}"
            )
        if n_robots is not None and fault.robots and max(fault.robots) >= n_robots:
            errors.append(
                f"fault {number}: {fault.kind} names robot {max(fault.robots)}; "
                f"a world has {n_robots}, numbered from 0"
            )
    raise_errors(errors)


def _parse_fault(values: Any) -> Fault:
    """Return the fault that a mapping with a kind and its fields describes."""
    fields = dict(values) if isinstance(values, Mapping) else {"kind": values}
    kind = str(fields.pop("kind", None))
    if kind not in FAULT_KINDS:
        hint = suggest_names(kind, FAULT_KINDS)
        raise OmniError(f"kind must be a kind of fault, not {format_value(kind)}; {hint}")
    return FAULT_KINDS[kind](**fields)
