"""Loads of a world's wheels by a loop, compiled or not, that goes through MuJoCo's contacts once.

A contact sensor of MuJoCo's looks through all contacts for itself; 12 robots have 48 of them. The loop writes what
they would show where they would.
"""

import ctypes
import math
from functools import cache
from typing import Any

import mujoco
import numpy as np

from omni_mj.onboard import addresses
from omni_mj.onboard.addresses import floats, numbers, words

Table = np.ndarray

# The table: addresses of numbers and pointers in MuJoCo's data; sizes; the carpet's geom; addresses of what is shown,
# of the sensors' places in it and of each geom's; where a contact has its fields.
CONTACTS, ROWS, FIRST, FORCE, SENSORS, GEOMS, CARPET, SHOWN, PLACES, OF_GEOM = range(10)
SIZE, FRAME, ADHESION, DIMENSIONS, TOUCHING, ROW = range(10, 16)
END = 16


class Loads:
    """In place of those sensors of a model that the build of worlds adds (`omni_mj.worlds.build`).

    Args:
        model: whose sensors are switched off.
        data: of it.

    Attributes:
        table: what `weigh` is handed.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        kinds = model.sensor_type == mujoco.mjtSensor.mjSENS_CONTACT, model.sensor_reftype == mujoco.mjtObj.mjOBJ_XBODY
        self._sensors = np.flatnonzero(kinds[0] & kinds[1])
        self._places = model.sensor_adr[self._sensors].astype(np.int64)
        self._of_geom = np.full(model.ngeom, -1)
        for body, place in zip(model.sensor_refid[self._sensors], self._places, strict=True):
            self._of_geom[[_within(model, part, body) for part in model.geom_bodyid]] = place
        carpets = model.sensor_objid[self._sensors]
        model.sensor_needstage[self._sensors] = mujoco.mjtStage.mjSTAGE_NONE
        whole, contact, base = _layout("mjData"), _layout("mjContact"), data._address
        self.table: Table = np.zeros(END, np.int64)
        self.table[:SENSORS] = [base + getattr(whole, name).offset for name in ("ncon", "nefc", "contact", "efc_force")]
        self.table[SENSORS:SHOWN] = len(carpets), model.ngeom, carpets[0] if len(carpets) else -1
        self.table[SHOWN:SIZE] = [addresses.of(each) for each in (data.sensordata, self._places, self._of_geom)]
        self.table[SIZE] = ctypes.sizeof(contact)
        self.table[FRAME:] = [
            getattr(contact, name).offset for name in ("frame", "adhesion", "dim", "geom", "efc_address")
        ]

    def give_back(self, model: mujoco.MjModel) -> None:
        """Switch the sensors of a copy of the model on."""
        model.sensor_needstage[self._sensors] = mujoco.mjtStage.mjSTAGE_ACC


def weigh(t: Table) -> None:
    """Write the force between carpet and each rim, world frame, N, where its sensor has it."""
    shown, places = _shown(t), numbers(t[PLACES], (t[SENSORS],))
    for place in places:
        shown[place] = shown[place + 1] = shown[place + 2] = 0.0
    count, rows = words(t[CONTACTS], (1,))[0], words(t[ROWS], (1,))[0]
    if count == 0 or rows == 0:
        return
    first, of_geom = numbers(t[FIRST], (1,))[0], numbers(t[OF_GEOM], (t[GEOMS],))
    force, whole = floats(numbers(t[FORCE], (1,))[0], (rows,)), words(first, (count, t[SIZE] // 4))
    real, frame, adhesion = floats(first, (count, t[SIZE] // 8)), t[FRAME] // 8, t[ADHESION] // 8
    for i in range(count):
        one, other, row = whole[i, t[TOUCHING] // 4], whole[i, t[TOUCHING] // 4 + 1], whole[i, t[ROW] // 4]
        roller, sign = (other, 1.0) if one == t[CARPET] else (one, -1.0)
        if row < 0 or roller < 0 or (other != t[CARPET] and one != t[CARPET]) or of_geom[roller] < 0:
            continue
        for k in range(min(whole[i, t[DIMENSIONS] // 4], 3)):
            along = sign * (force[row + k] - (real[i, adhesion] if k == 0 else 0.0))
            for axis in range(3):
                shown[of_geom[roller] + axis] += real[i, frame + 3 * k + axis] * along


def _shown(t: Table) -> np.ndarray:
    """What the sensors show, as far as the last of those that are replaced."""
    places = numbers(t[PLACES], (t[SENSORS],))
    return floats(t[SHOWN], (places.max() + 3 if len(places) else 0,))


def _within(model: mujoco.MjModel, part: int, body: int) -> bool:
    """Whether a body is another, or hangs on it: it has a greater number than what it hangs on."""
    while part > body:
        part = model.body_parentid[part]
    return part == body


@cache
def _layout(name: str) -> Any:
    """A structure of MuJoCo's as ctypes has it, with the offsets of its fields, by MuJoCo's own description."""
    from mujoco.introspect.ast_nodes import ArrayType, PointerType
    from mujoco.introspect.structs import STRUCTS

    numbers = {
        "int": ctypes.c_int,
        "mjtNum": ctypes.c_double,
        "mjtSize": ctypes.c_int64,
        "mjtBool": ctypes.c_bool,
        "size_t": ctypes.c_size_t,
        "uintptr_t": ctypes.c_size_t,
        "uint64_t": ctypes.c_uint64,
    }

    def kind(declared: Any) -> Any:
        if isinstance(declared, PointerType):
            return ctypes.c_void_p
        if isinstance(declared, ArrayType):
            return kind(declared.inner_type) * math.prod(declared.extents)
        return numbers.get(declared.name) or _layout(declared.name)

    fields = [(field.name, kind(field.type)) for field in STRUCTS[name].fields]
    return type(name, (ctypes.Structure,), {"_fields_": fields})
