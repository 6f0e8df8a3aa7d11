"""States under test: one of every supported joint, a humanoid, and products."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.state import ProductState, State, StateMultibody, StateVector

AXIS = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
CONTINUOUS_URDF = """<robot name="r"><link name="a"/><link name="b"/>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="1 2 3"/></joint></robot>"""


def model_of(**joints: pin.JointModel) -> pin.Model:
    """A chain of joints with position limits +-2 and velocity limits 3 wherever they can have any."""
    model = pin.Model()
    model.name = "chain"
    for name, joint in joints.items():
        model.addJoint(model.njoints - 1, joint, pin.SE3.Identity(), name)
    model.lowerPositionLimit = np.full(model.nq, -2.0)
    model.upperPositionLimit = np.full(model.nq, 2.0)
    model.upperVelocityLimit = np.full(model.nv, 3.0)
    return model


def every_joint() -> pin.Model:
    return model_of(
        root=pin.JointModelFreeFlyer(),
        rx=pin.JointModelRX(),
        continuous_y=pin.JointModelRUBY(),
        py=pin.JointModelPY(),
        oblique=pin.JointModelRevoluteUnaligned(AXIS),
        ball=pin.JointModelSpherical(),
        slider=pin.JointModelPrismaticUnaligned(AXIS),
        continuous_oblique=pin.buildModelFromXML(CONTINUOUS_URDF).joints[1],
        rz=pin.JointModelRZ(),
        second_root=pin.JointModelFreeFlyer(),
    )


def humanoid() -> pin.Model:
    model = pin.buildSampleModelHumanoid()
    model.upperVelocityLimit = np.full(model.nv, 5.0)
    return model


STATES: dict[str, State] = {
    "vector": StateVector(4),
    "every joint": StateMultibody(every_joint()),
    "humanoid": StateMultibody(humanoid()),
    "product": ProductState(
        StateVector(2),
        StateMultibody(every_joint()),
        ProductState(StateMultibody(model_of(ball=pin.JointModelSpherical())), StateVector(1)),
    ),
}


@pytest.fixture(params=STATES.values(), ids=STATES.keys())
def state(request: pytest.FixtureRequest) -> State:
    return request.param


@pytest.fixture
def multibody() -> StateMultibody:
    return STATES["every joint"]


@pytest.fixture
def points(state: State) -> list[np.ndarray]:
    """A few random points of ``state``."""
    rng = np.random.default_rng(7)
    return [state.integrate(state.neutral(), rng.uniform(-2.0, 2.0, state.ndx)) for _ in range(4)]


@pytest.fixture
def make_model():
    return model_of
