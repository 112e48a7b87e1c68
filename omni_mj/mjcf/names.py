"""What parts of a robot are called."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Names:
    """What parts are called, where structure does not say which they are; empty where it does.

    Args:
        chassis: the body with the free joint.
        wheels: hinges of the wheels, in their order.
        motors: the <dcmotor>s of the wheels, in their order.
        encoders: <jointpos> sensors of the wheels, in their order.
        gyro: the <gyro> sensor.
        hull: geoms with which robots meet.
    """

    chassis: tuple[str, ...] = ()
    wheels: tuple[str, ...] = ()
    motors: tuple[str, ...] = ()
    encoders: tuple[str, ...] = ()
    gyro: tuple[str, ...] = ()
    hull: tuple[str, ...] = ()
