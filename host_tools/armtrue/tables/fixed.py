"""The firmware's own code on the host: the shared library that firmware/ports/host builds, over ctypes."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.errors import InputError
from armtrue.tables import layout
from armtrue.tables.chain import Chain
from armtrue.tables.reference import Surroundings

TOO_COSTLY = 20  # Refusal::kTooCostly
_LIBRARY = Path(__file__).with_name("_fixed.so")
MAGNITUDE_CLAMPED = 1
NEAR_SINGULAR = 4
OUTSIDE_COVERAGE = 8
STATE_SATURATED = 16
# The firmware takes temperature, payload and time as integers: counts per kelvin, kilogram and second
# (docs/table-format.md).
_TEMPERATURE_SCALE = 2.0**20
_PAYLOAD_SCALE = 2.0**20
_TIME_SCALE = 2.0**10


class _Surroundings(ctypes.Structure):
    _fields_: ClassVar = [
        (name, ctypes.c_void_p) for name in ("temperature_difference", "payload", "time", "direction", "tool")
    ]


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    """The shared library. Errors: InputError where it is not built."""
    if not _LIBRARY.is_file():
        raise InputError(f"{_LIBRARY}: found no such file, expected the fixed-point engine; run ./dev build")
    loaded = ctypes.CDLL(str(_LIBRARY))
    loaded.armtrue_refusal_name.restype = ctypes.c_char_p
    loaded.armtrue_cycle_cost.restype = ctypes.c_uint32
    loaded.armtrue_cycle_budget.restype = ctypes.c_uint32
    for name in (
        "armtrue_solve",
        "armtrue_coordinates",
        "armtrue_ed25519_public_key",
        "armtrue_ed25519_sign",
    ):
        getattr(loaded, name).restype = None
    return loaded


@dataclass(frozen=True)
class Verdict:
    """A device's verdict on an image. `refusal` 0: accepted; `field`: byte offset of the field at fault."""

    refusal: int
    reason: str
    field: int

    @property
    def accepted(self) -> bool:
        """True where a device would take the image."""
        return self.refusal == 0


def validate(
    image: bytes, serial: str | None = None, joints: int = 0, public_key: bytes | None = None
) -> Verdict:
    """Judge `image` as a device bound to `serial`, with `joints` joints (0: any) and `public_key`, would."""
    field = ctypes.c_uint32()
    refusal = library().armtrue_validate(
        image,
        ctypes.c_size_t(len(image)),
        None if serial is None else serial.encode().ljust(layout.SERIAL_LENGTH, b"\0"),
        ctypes.c_uint8(joints),
        public_key,
        ctypes.byref(field),
    )
    name = library().armtrue_refusal_name(ctypes.c_int32(refusal))
    return Verdict(refusal, name.decode(), field.value)


def cycle_cost(image: bytes) -> int:
    """Instructions that a control cycle takes at most with an accepted `image`, by the firmware's own count."""
    return int(library().armtrue_cycle_cost(image, ctypes.c_size_t(len(image))))


def cycle_budget() -> int:
    """Most instructions per control cycle that a device accepts: `validate` refuses an image above it."""
    return int(library().armtrue_cycle_budget())


@dataclass(frozen=True)
class Corrected:
    """Result of the fixed-point engine: joints (N, n) [rad or m] and flags (N,)."""

    joints: Array
    flags: NDArray[np.uint16]


class FixedEngine:
    """Corrects poses with an image of the arm `chain` that `validate` accepted."""

    def __init__(self, image: bytes, chain: Chain) -> None:
        self.image = image
        self.chain = chain
        self.unit = np.where(
            chain.prismatic, 1.0, 1.0 / (2.0 * np.pi)
        )  # native units (m or turn) per m or rad

    def solve(self, joints: Array, around: Surroundings, tool: NDArray[np.uint8] | None = None) -> Corrected:
        """Correct commanded joints (N, n), each row on its own. `tool`: number of each row's tool."""
        target = self.to_positions(joints)
        delta = np.zeros(target.shape, dtype=np.int32)
        flags = np.zeros(len(target), dtype=np.uint16)
        is_clipped = self._call("armtrue_solve", target, around, tool, delta, flags)
        flags[is_clipped] |= np.uint16(STATE_SATURATED)
        corrected = (target + delta) * (2.0**-layout.POSITION_FRACTION / self.unit)
        return Corrected(corrected, flags)

    def coordinates(self, joints: Array, around: Surroundings) -> Array:
        """Every coordinate at commanded joints, (N, 68) [rad or m], in the order of docs/table-format.md."""
        target = self.to_positions(joints)
        result = np.zeros((len(target), layout.COORDINATES), dtype=np.int32)
        self._call("armtrue_coordinates", target, around, None, result)
        return np.asarray(result * 2.0**-layout.COORDINATE_FRACTION, dtype=np.float64)

    def to_positions(self, joints: Array) -> NDArray[np.int64]:
        """Joints in 2^-32 turn or metre."""
        return np.ascontiguousarray(
            np.round(joints * self.unit * 2.0**layout.POSITION_FRACTION).astype(np.int64)
        )

    def _call(
        self,
        function: str,
        target: NDArray[np.int64],
        around: Surroundings,
        tool: NDArray[np.uint8] | None,
        *results: NDArray[np.generic],
    ) -> NDArray[np.bool_]:
        """Call a function of the library for all rows of `target`; it writes into `results`.

        Returns a mask of the rows with an input beyond 32 bits: the firmware gets it clipped, and cannot tell.
        """
        scaled = self._scaled(around, len(target))
        integers = [None if values is None else _to_int32(values) for values in scaled]
        direction = None if around.direction is None else np.sign(around.direction).astype(np.int8)
        # The structure holds addresses only: these arrays live until after the call.
        arrays = [
            None if array is None else np.ascontiguousarray(array) for array in (*integers, direction, tool)
        ]
        getattr(library(), function)(
            self.image,
            ctypes.c_size_t(len(self.image)),
            ctypes.c_size_t(len(target)),
            _pointer(target),
            ctypes.byref(_Surroundings(*(None if array is None else array.ctypes.data for array in arrays))),
            *map(_pointer, results),
        )
        clipped = np.zeros(len(target), dtype=np.bool_)
        for values, integer in zip(scaled, integers, strict=True):
            if values is not None:
                differs = np.asarray(integer != np.round(values))
                clipped |= differs.reshape(len(target), -1).any(axis=1)
        return clipped

    def _scaled(self, around: Surroundings, rows: int) -> list[Array | None]:
        """Temperatures (N, sensors), payload and time in the firmware's counts, not yet rounded."""
        temperature = np.zeros((rows, len(self.chain.sensors)))
        for s, sensor in enumerate(self.chain.sensors):
            if sensor in around.temperature:
                temperature[:, s] = (
                    around.temperature[sensor] - self.chain.temperature_reference
                ) * _TEMPERATURE_SCALE
        return [
            temperature if self.chain.sensors else None,
            None if around.payload is None else around.payload * _PAYLOAD_SCALE,
            None if around.time is None else around.time * _TIME_SCALE,
        ]


def _to_int32(values: Array) -> NDArray[np.int32]:
    """Rounded and saturated."""
    return np.clip(np.round(values), -(2**31), 2**31 - 1).astype(np.int32)


def _pointer(array: NDArray[np.generic]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
