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

# The table: addresses of numbers and pointers in MuJoCo's data; how many sensors and geoms there are; the carpet;
# addresses of what is shown, of the sensors' places in it and of each geom's; bytes of a contact, and where it has its
# fields, counted in float64 and in int32.
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
        carpet = model.geom("carpet").id
        added = (model.sensor_type == mujoco.mjtSensor.mjSENS_CONTACT) & (model.sensor_objid == carpet)
        self._sensors = np.flatnonzero(added & (model.sensor_objtype == mujoco.mjtObj.mjOBJ_GEOM))
        self._places = model.sensor_adr[self._sensors].astype(np.int64)
        rims = dict(zip(model.sensor_refid[self._sensors].tolist(), self._places.tolist(), strict=True))
        self._of_geom = np.full(model.ngeom, -1)
        for geom, body in enumerate(model.geom_bodyid.tolist()):
            while body and body not in rims:
                body = int(model.body_parentid[body])
            self._of_geom[geom] = rims.get(body, -1)
        model.sensor_needstage[self._sensors] = mujoco.mjtStage.mjSTAGE_NONE
        whole, contact, base = _layout("mjData"), _layout("mjContact"), data._address
        self.table: Table = np.zeros(END, np.int64)
        self.table[:SENSORS] = [base + getattr(whole, name).offset for name in ("ncon", "nefc", "contact", "efc_force")]
        self.table[SENSORS:SHOWN] = len(self._places), model.ngeom, carpet
        self.table[SHOWN:SIZE] = [addresses.of(each) for each in (data.sensordata, self._places, self._of_geom)]
        self.table[SIZE] = ctypes.sizeof(contact)
        self.table[FRAME:DIMENSIONS] = [getattr(contact, name).offset // 8 for name in ("frame", "adhesion")]
        self.table[DIMENSIONS:] = [getattr(contact, name).offset // 4 for name in ("dim", "geom", "efc_address")]

    def give_back(self, model: mujoco.MjModel) -> None:
        """Switch the sensors of a copy of the model on."""
        model.sensor_needstage[self._sensors] = mujoco.mjtStage.mjSTAGE_ACC


def weigh(t: Table) -> None:
    """Write the force between carpet and each rim, world frame, N, where its sensor has it."""
    places = numbers(t[PLACES], (t[SENSORS],))
    if len(places) == 0:
        return
    shown = floats(t[SHOWN], (places.max() + 3,))
    for place in places:
        shown[place] = shown[place + 1] = shown[place + 2] = 0.0
    count, rows = words(t[CONTACTS], (1,))[0], words(t[ROWS], (1,))[0]
    if count == 0 or rows == 0:
        return
    first, of_geom = numbers(t[FIRST], (1,))[0], numbers(t[OF_GEOM], (t[GEOMS],))
    force, whole = floats(numbers(t[FORCE], (1,))[0], (rows,)), words(first, (count, t[SIZE] // 4))
    real, frame = floats(first, (count, t[SIZE] // 8)), t[FRAME]
    for i in range(count):
        one, other, row = whole[i, t[TOUCHING]], whole[i, t[TOUCHING] + 1], whole[i, t[ROW]]
        roller, sign = (other, 1.0) if one == t[CARPET] else (one, -1.0)
        if row < 0 or roller < 0 or t[CARPET] not in (one, other) or of_geom[roller] < 0:
            continue
        for k in range(min(whole[i, t[DIMENSIONS]], 3)):
            along = sign * (force[row + k] - (real[i, t[ADHESION]] if k == 0 else 0.0))
            for axis in range(3):
                shown[of_geom[roller] + axis] += real[i, frame + 3 * k + axis] * along


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
