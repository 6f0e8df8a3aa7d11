"""Messages of Unitree's robots, as in the public unitree_sdk2: one table for CDR bytes, C structs and IDL types.

Values are alike in the CDR bytes on the network and in the C struct over which the robots compute their checksum, but
at other places: structs are padded in C, not in CDR. So bytes are moved by an index, and read through numpy views: 20
times faster than a serialiser in Python. Families: ``go`` (Go2, B2) and ``hg`` (G1, H1-2).
"""

import zlib
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np


class Struct(NamedTuple):
    """A message, or a part of one.

    Attributes:
        name: of the IDL type.
        fields: name, type (a numpy code, ``str``, ``bytes`` or a struct), and length; 0 for a single value.
    """

    name: str
    fields: tuple[tuple[str, Any, int], ...]


def _struct(family: str, name: str, fields: str, **parts: Struct) -> Struct:
    """Return a struct from words ``name:type`` or ``name:type*length``."""
    found = []
    for word in fields.split():
        field, _, kind = word.partition(":")
        kind, _, length = kind.partition("*")
        found.append((field, parts.get(kind, kind), int(length or 0)))
    return Struct(f"unitree_{family}.msg.dds_.{name}", tuple(found))


_GO_IMU = _struct("go", "IMUState_", "quaternion:f4*4 gyroscope:f4*3 accelerometer:f4*3 rpy:f4*3 temperature:u1")
_GO_MOTOR_STATE = _struct(
    "go",
    "MotorState_",
    "mode:u1 q:f4 dq:f4 ddq:f4 tau_est:f4 q_raw:f4 dq_raw:f4 ddq_raw:f4 temperature:u1 lost:u4 reserve:u4*2",
)
_GO_BATTERY = _struct(
    "go",
    "BmsState_",
    "version_high:u1 version_low:u1 status:u1 soc:u1 current:i4 cycle:u2 bq_ntc:u1*2 mcu_ntc:u1*2 cell_vol:u2*15",
)
_GO_MOTOR = _struct("go", "MotorCmd_", "mode:u1 q:f4 dq:f4 tau:f4 kp:f4 kd:f4 reserve:u4*3")
_GO_OFF = _struct("go", "BmsCmd_", "off:u1 reserve:u1*3")
_HEAD = "head:u1*2 level_flag:u1 frame_reserve:u1 sn:u4*2 version:u4*2 bandwidth:u2 "
_HG_IMU = _struct("hg", "IMUState_", "quaternion:f4*4 gyroscope:f4*3 accelerometer:f4*3 rpy:f4*3 temperature:i2")
_HG_MOTOR_STATE = _struct(
    "hg",
    "MotorState_",
    "mode:u1 q:f4 dq:f4 ddq:f4 tau_est:f4 temperature:i2*2 vol:f4 sensor:u4*2 motorstate:u4 reserve:u4*4",
)
_HG_MOTOR = _struct("hg", "MotorCmd_", "mode:u1 q:f4 dq:f4 tau:f4 kp:f4 kd:f4 reserve:u4")

STATES = {
    "go": _struct(
        "go",
        "LowState_",
        _HEAD + "imu_state:imu motor_state:motor*20 bms_state:battery foot_force:i2*4 foot_force_est:i2*4 tick:u4"
        " wireless_remote:u1*40 bit_flag:u1 adc_reel:f4 temperature_ntc1:u1 temperature_ntc2:u1 power_v:f4 power_a:f4"
        " fan_frequency:u2*4 reserve:u4 crc:u4",
        imu=_GO_IMU,
        motor=_GO_MOTOR_STATE,
        battery=_GO_BATTERY,
    ),
    "hg": _struct(
        "hg",
        "LowState_",
        "version:u4*2 mode_pr:u1 mode_machine:u1 tick:u4 imu_state:imu motor_state:motor*35 wireless_remote:u1*40"
        " reserve:u4*4 crc:u4",
        imu=_HG_IMU,
        motor=_HG_MOTOR_STATE,
    ),
}
"""``rt/lowstate``."""

COMMANDS = {
    "go": _struct(
        "go",
        "LowCmd_",
        _HEAD + "motor_cmd:motor*20 bms_cmd:off wireless_remote:u1*40 led:u1*12 fan:u1*2 gpio:u1 reserve:u4 crc:u4",
        motor=_GO_MOTOR,
        off=_GO_OFF,
    ),
    "hg": _struct(
        "hg", "LowCmd_", "mode_pr:u1 mode_machine:u1 motor_cmd:motor*35 reserve:u4*4 crc:u4", motor=_HG_MOTOR
    ),
}
"""``rt/lowcmd``."""

_IDENTITY = _struct("api", "RequestIdentity_", "id:i8 api_id:i8")
REQUEST = _struct(
    "api",
    "Request_",
    "header:header parameter:str binary:bytes",
    header=_struct(
        "api",
        "RequestHeader_",
        "identity:identity lease:lease policy:policy",
        identity=_IDENTITY,
        lease=_struct("api", "RequestLease_", "id:i8"),
        policy=_struct("api", "RequestPolicy_", "priority:i4 noreply:bool"),
    ),
)
"""A call of one of the robot's services."""
RESPONSE = _struct(
    "api",
    "Response_",
    "header:header data:str binary:bytes",
    header=_struct(
        "api",
        "ResponseHeader_",
        "identity:identity status:status",
        identity=_IDENTITY,
        status=_struct("api", "ResponseStatus_", "code:i4"),
    ),
)
"""Its answer."""

_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def crc32(words: bytes) -> int:
    """Return Unitree's checksum of little-endian 32-bit words: polynomial 0x04c11db7, most significant bits first.

    It begins with ones, and has no final inversion; zlib's has the reverse order of bits.
    """
    swapped = np.frombuffer(words, "<u4").astype(">u4").tobytes().translate(_REVERSED)
    return int(f"{zlib.crc32(swapped) ^ 0xFFFFFFFF:032b}"[::-1], 2)


class Codec:
    """Conversion of a message of fixed size between CDR bytes and a record.

    Args:
        struct: of numbers only, whose last field is the checksum ``crc``.

    Attributes:
        dtype: of records, the C struct.
    """

    def __init__(self, struct: Struct) -> None:
        self.dtype = _dtype(struct)
        places: list[tuple[int, int]] = []
        end = _places(struct, self.dtype, 0, 0, places)
        self._in_c, self._in_cdr = np.array(places).T
        self._length = 4 + (end + 3) // 4 * 4  # with the header

    def record(self) -> Any:
        """Return a record of zeros."""
        return np.zeros(1, self.dtype)[0]

    def decode(self, data: bytes) -> Any:
        """Return the record of CDR bytes, with their header; None if they have another length or byte order."""
        if len(data) != self._length or data[1] & 1 == 0:
            return None
        content = np.zeros(self.dtype.itemsize, np.uint8)
        content[self._in_c] = np.frombuffer(data, np.uint8, offset=4)[self._in_cdr]
        return content.view(self.dtype)[0]

    def encode(self, record: Any) -> bytes:
        """Return the CDR bytes of a record, whose checksum is written before."""
        content = np.frombuffer(record.tobytes(), np.uint8)
        record["crc"] = crc32(content[:-4].tobytes())
        data = np.zeros(self._length, np.uint8)
        data[1] = 1  # little-endian
        data[4:][self._in_cdr] = np.frombuffer(record.tobytes(), np.uint8)[self._in_c]
        return data.tobytes()

    def intact(self, record: Any) -> bool:
        """Return whether a record has the checksum of its content."""
        return int(record["crc"]) == crc32(record.tobytes()[:-4])


def _dtype(struct: Struct) -> np.dtype[Any]:
    fields: list[Any] = []
    for name, kind, length in struct.fields:
        part = _dtype(kind) if isinstance(kind, Struct) else np.dtype(kind).newbyteorder("<")
        fields.append((name, part, (length,)) if length else (name, part))
    return np.dtype(fields, align=True)


def _places(struct: Struct, dtype: Any, in_c: int, in_cdr: int, places: list[tuple[int, int]]) -> int:
    """Append the places of a struct's bytes in C and in CDR, and return where it ends in CDR."""
    for name, kind, length in struct.fields:
        start = in_c + dtype.fields[name][1]
        part = dtype.fields[name][0].base
        for k in range(length or 1):
            if isinstance(kind, Struct):
                in_cdr = _places(kind, part, start + k * part.itemsize, in_cdr, places)
                continue
            in_cdr = -(-in_cdr // part.itemsize) * part.itemsize
            places += [(start + k * part.itemsize + byte, in_cdr + byte) for byte in range(part.itemsize)]
            in_cdr += part.itemsize
    return in_cdr


class _Types:
    """IDL types by name: each is made once, as DDS requires."""

    made: dict[str, Any] = {}

    @cached_property
    def plain(self) -> dict[str, Any]:
        from cyclonedds.idl import types

        codes = {"u1": "uint8", "u2": "uint16", "u4": "uint32", "i2": "int16", "i4": "int32", "i8": "int64"}
        plain = {code: getattr(types, name) for code, name in codes.items()}
        return plain | {"f4": types.float32, "str": str, "bool": bool, "bytes": types.sequence[types.uint8]}


_TYPES = _Types()


def idl_type(struct: Struct) -> Any:
    """Return the IDL type of a struct, for topics, and for typed messages."""
    from cyclonedds.idl import annotations, make_idl_struct, types

    if struct.name not in _TYPES.made:
        fields = {}
        for name, kind, length in struct.fields:
            part = idl_type(kind) if isinstance(kind, Struct) else _TYPES.plain[kind]
            fields[name] = types.array[part, length] if length else part
        made = make_idl_struct(struct.name.rpartition(".")[2], struct.name, fields)
        _TYPES.made[struct.name] = annotations.autoid("sequential")(annotations.final(made))
    return _TYPES.made[struct.name]
