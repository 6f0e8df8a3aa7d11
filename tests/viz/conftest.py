"""A short pushed run of Solo12 in MuJoCo under joint stiffness, recorded and saved as every run is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from snapshot import headless_chromium

from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.runs import Gate, Recorder, Run, RunFolder, RunLog, RunResult, compute_metrics, judge
from lgmpc.runs.forensics import explain_run
from lgmpc.runs.log import CONTACT_STATES, MODES
from lgmpc.simulation.mujoco import MujocoPlant
from lgmpc.viz import run_report, write_page

PUSH_START, PUSH_END = 0.3, 0.5
PUSH_FORCE = np.array([0.0, 5.0, 0.0])


@pytest.fixture(scope="session")
def solo12() -> Robot:
    return load_robot(
        RobotSpec(
            model="solo12",
            contact_frames=("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"),
            contact_radius_m=0.016,
            posture={"*_HAA": 0.0, "F?_HFE": 0.8, "F?_KFE": -1.6, "H?_HFE": -0.8, "H?_KFE": 1.6},
            effort_limit_nm=1.8,
            velocity_limit_rad_s=30.0,
            position_limit_rad=(-3.0, 3.0),
            armature_kg_m2=3.6e-4,
        )
    )


@pytest.fixture(scope="session")
def pushed_log(solo12: Robot) -> RunLog:
    return record_pushed_run(solo12, 1.2)


@pytest.fixture(scope="session")
def pushed_run(pushed_log: RunLog, tmp_path_factory: pytest.TempPathFactory) -> Run:
    return save(pushed_log, tmp_path_factory.mktemp("runs"))


def save(log: RunLog, out: Path) -> Run:
    metrics = compute_metrics(log, elapsed_s=0.4)
    result = RunResult("solo12_pushed", judge(metrics, Gate(max_tilt_deg=20.0)), metrics)
    folder = RunFolder.create(out, "solo12_pushed")
    folder.write_config("name: solo12_pushed\n")
    folder.write_arrays(log.decimated(2))
    folder.write_result(result)
    return RunFolder.load(folder.path)


def record_pushed_run(robot: Robot, duration: float) -> RunLog:
    """Stand by stiff joints, be pushed sideways for 0.2 s. The "prediction" is the centre of mass coasting to rest."""
    plant = MujocoPlant(robot)
    plant.reset(robot.x_reference)
    data = robot.create_data()
    ticks = round(duration / plant.dt)
    recorder = Recorder(
        nq=robot.nq,
        nv=robot.nv,
        effort_limit=robot.effort_limit,
        contact_frames=robot.contact_frames,
        friction=0.6,
        contact_radius=robot.contact_radius,
        control_period_s=plant.dt,
        ticks=ticks,
        mpc_nodes=20,
        mpc_period_s=0.01,
        mpc_updates=ticks // 10,
        joint_names=robot.joint_names,
    )
    share = np.tile([0.0, 0.0, robot.mass * 9.81 / robot.nc], (robot.nc, 1))
    jacobians = [
        pin.computeFrameJacobian(robot.model, data, robot.q_reference, frame, pin.LOCAL_WORLD_ALIGNED)[:3, 6:]
        for frame in robot.contact_ids
    ]
    gravity = pin.computeGeneralizedGravity(robot.model, data, robot.q_reference)[6:]
    standing = gravity - sum(jacobian.T @ force for jacobian, force in zip(jacobians, share, strict=True))
    start = pin.centerOfMass(robot.model, data, robot.q_reference).copy()
    ahead = np.linspace(0.0, 0.4, 21)[:, None]
    for k in range(ticks):
        time = k * plant.dt
        sample = plant.sense()
        pin.computeCentroidalMomentum(robot.model, data, sample.q, sample.v)
        pin.updateFramePlacements(robot.model, data)
        points = np.array([data.oMf[frame].translation - [0, 0, robot.contact_radius] for frame in robot.contact_ids])
        wrench = np.concatenate((PUSH_FORCE, np.zeros(3))) if PUSH_START <= time < PUSH_END else np.zeros(6)
        tau = standing + 12.0 * (robot.q_reference[7:] - sample.q[7:]) - 0.3 * sample.v[6:]
        if k % 10 == 0:
            horizon = data.com[0] + data.hg.linear / robot.mass * (ahead - 1.25 * ahead**2)
            recorder.record_mpc(time, horizon, share, 0, 0.4 + 0.1 * np.sin(0.1 * k))
        recorder.append(
            {
                "time": time,
                "q": sample.q,
                "v": sample.v,
                "tau": sample.tau,
                "tau_command": tau,
                "contact_forces": sample.contact_forces,
                "contact_forces_desired": share,
                "contact_points": points,
                "contact_normals": np.tile([0.0, 0.0, 1.0], (robot.nc, 1)),
                "com": data.com[0],
                "com_reference": start,
                "momentum": data.hg.vector,
                "base_reference": robot.q_reference[:7],
                "push": wrench,
                "push_point": plant.body_point("base_link"),
                "wbc_status": 0,
                "wbc_ms": 0.08 + 0.01 * np.cos(0.3 * k),
                "command": np.zeros(3),
                "mode": MODES.index("stand"),
                "gait_period_s": 0.24,
                "stance": np.ones(robot.nc),
                "contact_states": np.zeros(robot.nc),
                "swing_targets": points,
                "footholds": points,
            }
        )
        plant.set_wrench("base_link", wrench)
        plant.step(tau)
    return recorder.log()


SWING_START, SWING_END = 0.6, 0.8
FOOTHOLD = np.array([0.03, 0.02, 0.0])


@pytest.fixture(scope="session")
def stepping_log(pushed_log: RunLog) -> RunLog:
    """The pushed log as if foot 1 had swung to a foothold 3 cm ahead under a command to walk ahead and to the left."""
    n, foot = pushed_log.ticks, 1
    swinging = (pushed_log.time >= SWING_START) & (pushed_log.time < SWING_END)
    stance, states = np.ones((n, 4), dtype=np.int8), np.zeros((n, 4), dtype=np.int8)
    stance[swinging, foot], states[swinging, foot] = 0, CONTACT_STATES.index("swing")
    footholds, targets = pushed_log.contact_points.copy(), pushed_log.contact_points.copy()
    footholds[swinging, foot] += FOOTHOLD
    share = np.clip((pushed_log.time[swinging] - SWING_START) / (SWING_END - SWING_START), 0.0, 1.0)[:, None]
    targets[swinging, foot] += share * FOOTHOLD + np.sin(np.pi * share) * [0.0, 0.0, 0.03]
    command = np.where(pushed_log.time[:, None] >= 0.4, [0.3, 0.4, 0.0], 0.0)
    return replace(
        pushed_log,
        command=command,
        gait_period_s=np.full(n, 0.24),
        mode=np.full(n, MODES.index("locomote"), dtype=np.int8),
        stance=stance,
        contact_states=states,
        swing_targets=targets,
        footholds=footholds,
        mass_kg=2.5,
    )


@pytest.fixture(scope="session")
def report_file(solo12: Robot, pushed_run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of the pushed run, as one page."""
    gate = Gate(max_tilt_deg=20.0)
    page = run_report(solo12, pushed_run, gate.limits, explain_run(pushed_run, gate))
    return write_page(page, tmp_path_factory.mktemp("report") / "report.html")


@pytest.fixture(scope="module")  # a second one cannot be started while it runs
def browser() -> Iterator[Any]:
    with headless_chromium() as chromium:
        yield chromium
