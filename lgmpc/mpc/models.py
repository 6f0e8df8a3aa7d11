"""The predictive models: settings and constructor of each.

A new model is a module with its settings, a ``model: Literal[...]`` among them, and its controller, and one line in the
table here.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from lgmpc.costs import CostItem
from lgmpc.mpc.centroidal import CentroidalMpc, CentroidalMpcSettings
from lgmpc.mpc.fallback import FallbackMpc
from lgmpc.mpc.full_body import FullBodyMpc, FullBodyMpcSettings
from lgmpc.mpc.interface import Mpc
from lgmpc.mpc.settings import MpcSettings
from lgmpc.robot import Robot
from lgmpc.settings import one_of


def _full_body(robot: Robot, settings: FullBodyMpcSettings, costs: Sequence[CostItem] = ()) -> Mpc:
    """Return the full-body model with a centroidal fallback of the same horizon and limits."""
    shared = settings.model_dump(include=set(CentroidalMpcSettings.model_fields) - {"model", "weights"})
    centroidal = CentroidalMpc.of(robot, CentroidalMpcSettings(**shared))
    return FallbackMpc(FullBodyMpc(robot, settings, costs), centroidal)


_MODELS: Mapping[type[MpcSettings], Callable[..., Mpc]] = {
    CentroidalMpcSettings: CentroidalMpc.of,
    FullBodyMpcSettings: _full_body,
}


if TYPE_CHECKING:
    AnyMpcSettings = MpcSettings
else:
    AnyMpcSettings = one_of({each.model_fields["model"].default: each for each in _MODELS}, "model")
    """The settings of one of the models; the key ``model`` selects which."""


def make_mpc(robot: Robot, settings: MpcSettings, costs: Sequence[CostItem] = ()) -> Mpc:
    """Return the predictive controller for ``settings``.

    Args:
        robot: the controller's model of the robot.
        settings: settings of one of the models.
        costs: further costs of a model with base and joints.
    """
    return _MODELS[type(settings)](robot, settings, *([costs] if costs else []))
