"""Largest push that a robot survives: with its feet where they were, with steps, or while it walks.

On the benchmark plant (MuJoCo) the base, or the torso of a humanoid, is pushed for 0.2 s by a constant horizontal
force; for each direction the largest impulse is found by bisection. Half a second into standing, "stay" means that the
robot is up two seconds later and every contact point is within 2 cm of where it was; this is compared between the
whole-body QP alone and with the MPC above it. With steps or a command, "survived" and "recovered" mean what they mean
in bench_locomotion.py.

    python scripts/push_recovery.py                      # friction 0.6, 12 directions: some minutes
    python scripts/push_recovery.py --stepping           # standing; it may step
    python scripts/push_recovery.py --command 0.5,0,0 --phases 4   # m/s ahead, m/s left, rad/s
    python scripts/push_recovery.py --friction 0.4 0.5 0.7 --directions 12 --set mpc.qp_solver=piqp
    python scripts/push_recovery.py --model full_body    # what predicts
    python scripts/push_recovery.py --robot talos --directions 8 --map talos.png    # a polar map, tens of minutes

Beside the map is the bound of a pendulum: a robot whose feet stay and that has no angular momentum (`pendulum_bound`).

What is estimated only while the robot walks, such as joint friction, it learns in a warm-up: a trot, after which it
stands again for a second before it is pushed (with the MPC: without a plan it only stands).

    python scripts/push_recovery.py --warm-up 3 --set plant.joint_friction_nm=0.1 --set joint_friction={}
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import logging
from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin
from bench_locomotion import FOOT_LIMIT_M, PUSH_S, STEPPING, STRONGEST_NS, Bench, Motion, largest, pushes
from record import add_json_option, print_machine, write_record
from scipy.spatial import ConvexHull

from lgmpc.config.build import build_robot, prepare
from lgmpc.config.loading import load_config
from lgmpc.robot import Robot
from lgmpc.sweeps.report import boundary_drawing
from lgmpc.viz.figure_files import draw_figures

CONFIGS = Path(__file__).parent.parent / "configs"
ROBOTS = {"solo12": "solo12_balance", "talos": "talos_stand", "talos_legs": "talos_legs_stand", "g1": "g1_stand"}
STEPPING_ROBOTS = {**ROBOTS, "talos": "talos_push_steps"}
MODELS = {"centroidal": "", "full_body": "_full_body"}
DURATION_S = 2.5
START_S = 0.5
WARM_UP_M_S, STOP_S = 0.3, 1.0
SOLO12_KG = 2.5  # impulses of the search scale with the mass
CONTROLLERS = {"whole-body QP": "mpc.enabled=false", "MPC + whole-body QP": "mpc.enabled=true"}


def pendulum_bound(robot: Robot, body: str, angles: np.ndarray) -> np.ndarray:
    """Return the largest impulses towards ``angles`` that a pendulum on the feet of a robot takes in place, N.s.

    A constant force F at the height z_p of the body's centre of mass acts for T on a mass m that moves at the height h
    without angular momentum, w = sqrt(g / h). Its capture point xi and centre of pressure p, both in the support, obey
    xi' = w (xi - p) + F z_p / (m w h): with xi(0) = 0 a force of m w^2 d h / z_p E / (E - 1) is the largest, where
    E = exp(w T) and d is the distance of the support's edge from the centre of mass towards the push.
    """
    model, data = robot.model, robot.create_data()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    com = pin.centerOfMass(model, data, robot.q_reference)
    joint = model.frames[robot.body_frame(body)].parentJoint
    pushed = data.oMi[joint].act(model.inertias[joint].lever)[2]
    support = ConvexHull(np.array([data.oMf[i].translation[:2] for i in robot.contact_ids]) - com[:2]).equations
    towards = support[:, :2] @ np.array([np.cos(angles), np.sin(angles)])
    edge = np.min(np.where(towards > 1e-9, -support[:, 2:] / np.maximum(towards, 1e-9), np.inf), axis=0)
    square = -robot.gravity[2] / com[2]
    grown = np.exp(np.sqrt(square) * PUSH_S)
    bound: np.ndarray = robot.mass * square * PUSH_S * edge * com[2] / pushed * grown / (grown - 1.0)
    return bound


def stays(
    config_file: Path, overrides: list[str], warm_up: float, angle: float, impulse: float, body: str = "base_link"
) -> bool:
    """Return whether the robot is up, its feet where they were, after a push of ``impulse`` N.s towards ``angle``.

    With a ``warm_up``, s, it trots for so long and stands again before.
    """
    go, stop = f"{{at_s: 0.0, velocity_m_s: [{WARM_UP_M_S}, 0, 0]}}", f"{{at_s: {warm_up}, velocity_m_s: [0, 0, 0]}}"
    stands = warm_up + STOP_S if warm_up else 0.0
    push = [float(impulse * np.cos(angle)), float(impulse * np.sin(angle)), 0.0]
    keys = [
        f"commands=[{f'{go}, {stop}' if warm_up else ''}]",
        f"pushes=[{{body: {body}, time_s: {stands + START_S}, duration_s: {PUSH_S}, impulse_ns: {push}}}]",
        f"duration_s={stands + DURATION_S}",
    ]
    result = prepare(load_config(config_file, [*overrides, *keys])).run(lambda progress: None)
    if result.metrics is None or result.metrics.fell:
        return False
    feet = result.log.contact_points[result.log.time >= stands, :, :2]
    return bool(np.linalg.norm(feet - feet[0], axis=2).max() < FOOT_LIMIT_M)


def motion(text: str) -> Motion:
    """Return the command ``VX,VY,W``."""
    try:
        vx, vy, yaw_rate = (float(number) for number in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"got '{text}', expected three numbers VX,VY,W: m/s, m/s, rad/s") from None
    return Motion(vx, vy, yaw_rate)


def compare_standing(
    config_file: Path,
    same: list[str],
    warm_up: float,
    angles: np.ndarray,
    resolution: float,
    strongest: float,
    body: str,
) -> dict[str, dict[str, list[float]]]:
    """Print and return by controller the largest pushes that the feet hold in place."""
    found: dict[str, dict[str, list[float]]] = {}
    # Without a plan the robot only stands.
    for name, switch in [*CONTROLLERS.items()][1 if warm_up else 0 :]:
        pushed = partial(stays, config_file, [*same, switch], warm_up, body=body)
        held = [largest(partial(pushed, angle), resolution, strongest) for angle in angles]
        print(
            f"{name:20s} stay: median {np.median(held):.2f}  min {min(held):.2f}  max {max(held):.2f} N.s", flush=True
        )
        found[name] = {"stay_ns": [round(each, 3) for each in held]}
    return found


def draw_map(file: Path, angles: np.ndarray, pushed: dict[str, list[float] | np.ndarray]) -> None:
    """Draw the impulses of each controller and of the pendulum over their directions."""
    curves = {name: list(zip(angles, impulses, strict=True)) for name, impulses in pushed.items()}
    figures = draw_figures({file.stem: boundary_drawing(curves, "largest push in place, N.s")}, file.stem)
    print("written: " + ", ".join(map(str, figures.save(file.parent))))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", choices=list(ROBOTS), default="solo12", help="with soles it is pushed as it stands")
    parser.add_argument("--model", choices=list(MODELS), default="centroidal", help="what predicts, of Solo12")
    parser.add_argument("--friction", type=float, nargs="+", default=[0.6], help="of floor and controller")
    parser.add_argument("--command", type=motion, metavar="VX,VY,W", help="to trot at meanwhile, m/s, m/s, rad/s")
    parser.add_argument("--stepping", action="store_true", help="it may step where it stands")
    parser.add_argument("--warm-up", type=float, default=0.0, help="it trots for so long before, s; feet in place")
    parser.add_argument("--directions", type=int, default=12)
    parser.add_argument("--phases", type=int, default=1, help="of the gait at which pushes begin, with --command")
    parser.add_argument("--resolution", type=float, help="N.s; 0.05 for Solo12's 2.5 kg unless given")
    parser.add_argument("--map", type=Path, metavar="PNG", help="to draw what the feet hold in place there")
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    add_json_option(parser)
    arguments = parser.parse_args()
    logging.getLogger("lgmpc").setLevel(logging.ERROR)  # falls are figures here
    print_machine()
    angles = 2.0 * np.pi * np.arange(arguments.directions) / arguments.directions
    name = (STEPPING_ROBOTS if arguments.stepping else ROBOTS)[arguments.robot]
    config_file = CONFIGS / f"{name}{MODELS[arguments.model]}.yaml"
    config = load_config(config_file, arguments.overrides)
    robot, body = build_robot(config), config.pushes[0].body
    scale = robot.mass / SOLO12_KG
    resolution = arguments.resolution or 0.05 * scale
    bound = pendulum_bound(robot, body, angles)
    moving = arguments.command is not None and arguments.command.moves
    results = []
    for friction in arguments.friction:
        print(f"\nfriction {friction:.2f}")
        same = [f"{section}.friction={friction}" for section in ("plant", "mpc", "wbc")] + arguments.overrides
        found: dict[str, object]
        if moving or arguments.stepping:
            gait = "trot" if arguments.robot == "solo12" else "walk"
            bench = Bench(config_file, gait, [*same, STEPPING] if arguments.stepping else same)
            phases = arguments.phases if moving else 1
            command = arguments.command or Motion()
            found = pushes(bench, command, body, arguments.directions, phases, resolution)
        else:
            strongest = STRONGEST_NS * scale
            held = compare_standing(config_file, same, arguments.warm_up, angles, resolution, strongest, body)
            found = {"controllers": held, "pendulum_ns": bound.round(3).tolist()}
            print(f"{'pendulum':20s} median {np.median(bound):.2f}  min {bound.min():.2f}  max {bound.max():.2f} N.s")
            for angle, limit, *row in zip(angles, bound, *(each["stay_ns"] for each in held.values()), strict=True):
                cells = "  ".join(f"{impulse / robot.mass:.2f}" for impulse in row)
                print(f"  towards {np.degrees(angle):4.0f} deg  {cells}, pendulum {limit / robot.mass:.2f} N.s/kg")
            if arguments.map is not None:
                draw_map(arguments.map, angles, {**{k: v["stay_ns"] for k, v in held.items()}, "pendulum": bound})
        results.append({"friction": friction, **found})
    write_record(arguments.json, results)


if __name__ == "__main__":
    main()
