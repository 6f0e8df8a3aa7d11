"""Names of frames and degrees of freedom in a Pinocchio model, and their lists in messages."""

from collections.abc import Sequence

import pinocchio as pin

from lgmpc.errors import InputError


def frame_index(model: pin.Model, name: str, key: str = "frame") -> int:
    """Return the index of the first frame called ``name`` (a joint and its link may share a name).

    Raises:
        InputError: there is none; the nearest are named.
    """
    if isinstance(name, str):
        for index, frame in enumerate(model.frames):
            if frame.name == name:
                return index
    raise InputError(key, name, f"a frame of {model.name}", tuple(frame.name for frame in model.frames))


def is_floating(model: pin.Model) -> bool:
    """Return whether the first joint of ``model`` is a free-flyer."""
    return bool(model.njoints > 1 and model.joints[1].shortname() == "JointModelFreeFlyer")


def degree_names(model: pin.Model) -> tuple[str, ...]:
    """Return (nv,) a name for each degree of freedom: the joint's, with _0, _1, ... where it has several."""
    names: list[str] = []
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        names += [name] if joint.nv == 1 else [f"{name}_{k}" for k in range(joint.nv)]
    return tuple(names)


def some(names: Sequence[str], most: int = 4) -> str:
    """Return a list of up to ``most`` names and the number of further ones."""
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
