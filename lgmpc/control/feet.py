"""Per-tick management of the feet: contacts, footholds, swings, and the contacts ahead of them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from lgmpc.errors import InputError
from lgmpc.locomotion.clock import GaitClock
from lgmpc.locomotion.command import MotionCommand
from lgmpc.locomotion.contacts import ContactEvents
from lgmpc.locomotion.footholds import BaseMotion, FootholdPlanner
from lgmpc.locomotion.gait import Gait, find_gait
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.locomotion.legs import LegGeometry, leg_inertias, leg_momentum
from lgmpc.locomotion.maps import ElevationMap
from lgmpc.locomotion.reaction import StepSchedule, step_schedules
from lgmpc.locomotion.settings import LocomotionSettings
from lgmpc.locomotion.stepping import MappedBelief
from lgmpc.locomotion.swing import HeadingTrajectory, SwingTrajectory
from lgmpc.locomotion.terrain import TerrainBelief
from lgmpc.robot import Robot
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import Array, BoolArray
from lgmpc.wbc import Contacts, Task

Vector = Sequence[float]  # x, y, z

_RETURN_CYCLES = 2  # of steps in place: what the first one shifts, the second one corrects

_SETTLED_S = 0.018  # after its touchdown, from which a foot's sliding is evidence about the floor
_EVEN_SHARE = 0.03  # of the legs' scale: by so much less a touchdown may deviate on even ground
_BELOW_SHARE, _HANGING_SHARE = 0.015, 0.05
_ROUGHEST_SHARE = 0.2
_REMEMBERED = 0.97  # share of the roughness that is left after one more touchdown as expected
_PRESS_SHARE, _FALLING = 0.1, 0.4  # load that brings lost feet down, in weights; speed at which none is left, m/s
_LEAST_REACH_SHARE = 0.2  # of the legs' length: the least horizontal reach that counts for the speed


class Feet:
    """Steps of all feet: gait clock, contact events, footholds and swing trajectories as one.

    Args:
        robot: the controller's model.
        settings: of locomotion.
        gaits: by name, as commands choose them.
        contacts: of the whole-body QP, to write to.
        contact_age: of measured contacts, at the time for which the feet are updated, s.
        period: time between two updates, s.

    Attributes:
        settings: as given.
        gaits: as given.
        legs: geometry of the legs.
        clock: the schedule.
        events: measured contacts compared with the schedule.
        points: of the feet: what is decided per foot here is carried out per contact point.
        stance: (nf,) which feet carry at this tick.
        position: (nf, 3) targets of the feet in the air, of soles of their centres, world, m.
        velocity: (nf, 3) m/s.
        acceleration: (nf, 3) m/s2.
        footholds: (nf, 3) where each foot stands or will touch down next, world, m.
        yaws: (nf,) headings of soles there, rad.
        targets: (nc, 3) of the contact points of the feet in the air, world, m.
        stepping: whether a foot swings or is to lift off; one that lost its contact does not step.
        standing: whether all feet are on the ground, and none is to lift off.
        changed: whether other feet carry than at the last tick.
        lost: (nf,) which feet carry nothing, whatever the schedule says.
        settled: (nc,) points of feet that carry for long enough for their sliding to be evidence about the floor.
        ground: the plane under the robot, through the last footholds or of the map.
        mapped: the same where there is a map, or None.
        roughness: of the ground that was met lately, by which feet swing higher, m.
        shifts: (nf, 2) of the footholds of swings, ahead and to the left of the base, m; None for none.
        drawn: (x, y) by which a map moves the sole in the air from where the desired motion would have it, world, m.
    """

    def __init__(
        self, robot: Robot, settings: LocomotionSettings, gaits: Mapping[str, Gait], contacts: Contacts,
        contact_age: float = 0.0, period: float = 1e-3,
    ) -> None:  # fmt: skip
        self.legs = LegGeometry.of(robot)
        self.points = robot.foot_points
        self.ground = TerrainBelief(robot.nc, self.legs.height, settings.terrain)
        self.mapped: MappedBelief | None = None
        self.settings, self.gaits, self._contact_age = settings, gaits, contact_age
        self._places = self.legs.feet.tolist()
        self._inertias = None if self.points.single else leg_inertias(robot)
        self._planner = FootholdPlanner(self.legs, settings.footholds, self.ground)
        sole = not self.points.single
        self._swings = [SwingTrajectory(settings.swing, self.legs.scale, sole) for _ in range(robot.nf)]
        self.position, self.velocity, self.acceleration = np.zeros((3, robot.nf, 3))
        self.footholds, self._nominal = np.zeros((2, robot.nf, 3))
        self.ground.places = None if sole else self.footholds
        self.yaws = np.zeros(robot.nf)
        self._headings = [] if self.points.single else [HeadingTrajectory() for _ in range(robot.nf)]
        self.targets = self.position if self.points.single else np.zeros((robot.nc, 3))
        self.lost = np.zeros(robot.nf, dtype=np.bool_)
        self._level, self.roughness = True, 0.0
        self.shifts: Array | None = None
        self.drawn = (0.0, 0.0)
        self._contacts, self._bounds, self._period = contacts, ([1.0] * robot.nf, [False] * robot.nf), period
        self._points: Array = np.zeros((robot.nf, 3))  # of the feet, as measured last
        rows = zip(self.footholds, self.position, self.velocity, self.acceleration, strict=True)
        self._rows: list[tuple[Array, Array, Array, Array]] = list(rows)  # of each foot
        self._lowest, self._highest = contacts.lowest_normal.copy(), contacts.highest_normal.copy()
        self._velocities = np.zeros((robot.nc, 3))
        self._press = _PRESS_SHARE * robot.mass * float(np.linalg.norm(robot.gravity))
        self.begin(0.0, np.zeros((robot.nc, 3)), None)

    def retune(self, settings: LocomotionSettings, gaits: Mapping[str, Gait]) -> None:
        """Change swings, footholds and gaits from now on; other settings, and swings under way, stay as they are."""
        self.settings, self.gaits = settings, gaits
        self._planner = FootholdPlanner(self.legs, settings.footholds, self.ground)
        for swing in self._swings:
            swing.retune(settings.swing)

    def read_map(self, elevation: ElevationMap, pose: Array) -> None:
        """Step on the ground of a map from now on; ``pose`` (7,) is a live view of the base's.

        Raises:
            InputError: the map does not return one height, and one answer, for each point.
        """
        places = np.zeros((2, 2))
        for name, found in (("height", elevation.height(places)), ("steppable", elevation.steppable(places, 0.01))):
            if np.shape(found) != (2,) or np.asarray(found).dtype.kind not in "bf":
                got = f"an array of shape {np.shape(found)} of {np.asarray(found).dtype} from {name} for (2, 2) points"
                raise InputError("locomotion.terrain.map", got, "one of shape (2,), of heights or of booleans")
        belief = MappedBelief(self.points, self.legs, self.settings.terrain, elevation, pose)
        self.ground = self._planner.ground = self.mapped = belief

    def begin(self, time: float, points: Array, contacts: BoolArray | None) -> None:
        """Begin to stand at contact points (nc, 3); feet without a point in contact (nc,) are put down first."""
        self.ground.begin(points, contacts)
        self.yaws[:], self.targets[:], points = self.points.yaws(points), points, self.points.mean(points)
        contacts = None if contacts is None else self.points.touching(contacts)
        self.clock = GaitClock(find_gait(self.gaits, "stand"), time, self.settings.clock, contacts)
        self.events = ContactEvents(self.clock, self.settings.contacts, self._contact_age, self.legs.height)
        self.stance = self.events.stance
        self._stood: list[bool] = self.stance.tolist()
        for foot in np.flatnonzero(~self.stance).tolist():
            swing = self.clock.swing(foot, time)
            assert swing is not None
            self._swings[foot].put_down(time, swing.touchdown, points[foot])
        self.changed = False
        self.settled: list[bool] = self.points.spread(self.events.steady(time - _SETTLED_S))
        self.standing = contacts is None or bool(contacts.all())
        self.stepping = not self.standing
        self.footholds[:], self.position[:], self.velocity[:], self.acceleration[:] = points, points, 0.0, 0.0
        self._write_normals()

    @property
    def clearance(self) -> float:
        """Height of the swings' apex above the ground, m, the least of every swing."""
        return self._swings[0].clearance

    @property
    def point_footholds(self) -> Array:
        """(nc, 3) where each contact point stands or will touch down next, world, m."""
        if False not in self._stood:
            return self.targets
        return self.points.place(self.footholds, self.yaws, self.ground.normals)

    def gait(self, command: MotionCommand) -> Gait:
        """Return the gait of a command.

        Raises:
            InputError: there is none of this name.
        """
        return find_gait(self.gaits, command.gait)

    def within_reach(self, command: MotionCommand) -> MotionCommand:
        """Return the command, no faster than the legs' reach allows on the ground ahead of a map.

        Within a stance the base moves by as much as its feet reach ahead and back, with the base higher above the
        lowest of them by what the footholds are off their plane. Without a map, soles that go fast have the base low.
        """
        if not command.moves or (self.mapped is None and self.points.single):
            return command
        stance_s, speed = self.gait(command).stance_s, math.hypot(command.vx, command.vy)
        if self.mapped is None:  # as far as the robot moves in a stance: half of that suffices without errors
            return replace(command, height=min(command.height, self._planner.highest(speed * stance_s)))
        off = self.mapped.unevenness(self.footholds)
        reach = min(self._planner.reach(foot, command.height + off) for foot in range(self.clock.nc))
        most = 2.0 * max(reach, _LEAST_REACH_SHARE * float(self.legs.length.min())) / stance_s
        share = min(most / speed, 1.0) if speed > 0.0 else 1.0
        return command if share == 1.0 else replace(command, vx=command.vx * share, vy=command.vy * share)

    def follow(self, time: float, command: MotionCommand) -> None:
        """Follow the gait of a command; without velocity, stand. To stand, come to rest in the present gait."""
        if command.moves:
            gait = self.clock.gait if (commanded := self.gait(command)).stands else commanded
            # On soles the weight is shifted first, for as long as both feet of a walk stand: not fallen into the step.
            lead = 0.0 if self.points.single else max(0.5 * (gait.stance_s - gait.swing_s), 0.0)
            self.clock.follow(time, gait, True, lead)
        else:
            self.clock.stop(time)

    def step_schedules(self) -> tuple[StepSchedule, ...]:
        """Return the schedules to choose from where a push makes the robot step."""
        settings = self.settings.reaction
        return step_schedules(find_gait(self.gaits, settings.gait), settings.cycle_shares)

    def start(self, time: float, schedule: StepSchedule) -> None:
        """Start to step, until a command is followed."""
        self.clock.start(time, schedule.gait, first=schedule.first)
        self.standing, self.stepping = False, True

    def displacement(self, x: float, y: float, yaw: float) -> float:
        """Return the largest horizontal distance of a foot from its place in the reference posture, m.

        The centre of mass is at (x, y) there, world, m, and the base has the heading yaw, rad.
        """
        c, s = math.cos(yaw), math.sin(yaw)
        return max(
            math.hypot(x + c * ahead - s * left - at[0], y + s * ahead + c * left - at[1])
            for (ahead, left, _), at in zip(self._places, self.footholds.tolist(), strict=True)
        )

    def step_in_place(self, time: float) -> bool:
        """Start to step, each foot to its place; return False where there is no gait to step with."""
        gait = self.gaits.get(self.settings.reaction.gait)
        if gait is None or gait.stands:
            return False
        self.clock.start(time, gait, cycles=_RETURN_CYCLES)
        self.standing, self.stepping = False, True
        return True

    def update(
        self, time: float, points: Array, velocities: Array, contacts: BoolArray | None, motion: BaseMotion
    ) -> None:
        """Advance to ``time``: decide which feet carry, and where the others go.

        Args:
            time: s.
            points: (nc, 3) measured contact points, world, m.
            velocities: (nc, 3) of the feet, m/s.
            contacts: (nc,) measured contacts; None where nothing is measured.
            motion: of the robot in the plane.
        """
        corners, feet, single = points, self.points, self.points.single
        self.drawn = (0.0, 0.0)
        if self.mapped is not None:
            self.mapped.look(time, motion)
        if not single:
            points = feet.mean(points)
            contacts = None if contacts is None else feet.touching(contacts)
        self._points, self._velocities = points, velocities
        stance = self.events.update(time, contacts, self._below)
        stands = stance.tolist()
        self.changed = stands != self._stood
        if self.changed:
            for foot, (carries, stood) in enumerate(zip(stands, self._stood, strict=True)):
                if carries and not stood:
                    self._touch(abs(float(points[foot, 2]) - self._swings[foot].target[2]))
        if all(stands):
            self.footholds[...] = points
            self.position[...] = points
            if self.changed:
                self.velocity[:] = self.acceleration[:] = 0.0
            if not single:
                self.targets[:] = corners
                self.yaws[:] = feet.yaws(corners) if self.changed else self.yaws  # soles that stand do not turn
        else:
            moving = feet.mean(velocities).tolist()
            yaws = [] if single else feet.yaws(corners).tolist()
            for foot, (carries, point) in enumerate(zip(stands, points.tolist(), strict=True)):
                foothold, position, velocity, acceleration = self._rows[foot]
                if not carries:
                    self._swing(foot, time, point, moving[foot], 0.0 if single else yaws[foot], motion)
                    continue
                foothold[...] = position[...] = points[foot]
                if not single:
                    self.yaws[foot] = yaws[foot]
                if not self._stood[foot]:
                    velocity[...] = acceleration[...] = 0.0
        settled = self.events.steady(self.clock.time - _SETTLED_S)
        self.settled = settled if single else feet.spread(settled)
        self.ground.update(self._period, corners, self.settled)
        if not (self.ground.level and self._level) or self.mapped is not None:
            self._write_normals()
        self._stood = stands
        self.standing = self.events.resting
        self.stepping = not (self.standing or self.clock.rests(time))

    def _below(self, foot: int) -> bool:
        """Return whether a foot in the air is below the ground that it should have found.

        On rough ground any is that does not hang, above its path and slower: waiting brings no stretched leg down.
        """
        z, scale = float(self._points[foot, 2]), self.legs.scale
        if self._stood[foot] or self.roughness == 0.0:
            return not self._stood[foot] and z < self.footholds[foot, 2] - _BELOW_SHARE * scale
        falling = self._velocities[self.points.starts[foot], 2] < 0.5 * self.velocity[foot, 2]
        return bool(falling or z < self.position[foot, 2] + _HANGING_SHARE * scale) or not self.points.single

    def _write_normals(self) -> None:
        """Write the normals of the whole-body QP's contacts, for its next tick."""
        self._contacts.normals[...] = self.ground.normals
        self._level = self.ground.level

    def _swing(self, foot: int, time: float, point: Vector, velocity: Vector, yaw: float, motion: BaseMotion) -> None:
        """Move a foot in the air, which lifts off unless it has."""
        searched = self._swings[foot].touchdown <= time and not self.events.searching(foot)
        if self._stood[foot] or searched:  # a foot that found no ground begins its next swing in the air
            if self._headings:
                self._headings[foot].begin(time, yaw)
            self._lift(foot, time, point, velocity, motion)
        self._move(foot, time, point, velocity, motion)

    def _touch(self, deviation: float) -> None:
        """Take the deviation of a touchdown from its expected height, m, as evidence of rough ground."""
        unexpected = min(deviation - _EVEN_SHARE * self.legs.scale, _ROUGHEST_SHARE * self.legs.scale)
        self.roughness = max(_REMEMBERED * self.roughness, unexpected, 0.0)
        for swing in self._swings:
            swing.roughness = self.roughness

    def _lift(self, foot: int, time: float, point: Vector, velocity: Vector, motion: BaseMotion) -> None:
        swing = self.clock.swing(foot, time)
        if swing is None or self.events.searching(foot):
            self._swings[foot].search(time, point)
            return
        target = self._aim(foot, time, swing.touchdown, motion, True)
        path = self._swings[foot]
        latest = self.clock.latest_touchdown(foot, time)
        below = None if self.mapped is None else self.mapped.under(foot, point, target)
        path.lift_off(time, swing.touchdown, point, velocity, target, latest, below)
        self.clock.stretch(foot, time, path.touchdown)

    def _move(self, foot: int, time: float, point: Vector, velocity: Vector, motion: BaseMotion) -> None:
        path, (foothold, *rows) = self._swings[foot], self._rows[foot]
        if not self.events.searching(foot):
            moving = rows[1].tolist()
            obstructed = path.blocked(time, point, velocity, rows[0].tolist(), moving, self._period)
            if obstructed and (self.mapped is None or self.mapped.holds(point, moving)):
                self._touch(math.inf)
                path.step_over(time, point)
                self.clock.extend(foot, time, path.touchdown)
            if self._headings or not path.frozen(time):
                target = self._aim(foot, time, path.touchdown, motion)
                if path.retarget(time, target):
                    self.clock.stretch(foot, time, path.touchdown)
        elif path.held(point, velocity):
            path.search(time, point)
        elif self.events.below(foot):
            path.hasten(time)
        path.sample(time, *rows)
        if self._headings:
            self._headings[foot].retarget(time, path.touchdown, float(self.yaws[foot]))
        foothold[...] = path.target

    def _aim(self, foot: int, time: float, touchdown: float, motion: BaseMotion, begins: bool = False) -> Vector:
        """Write the foothold of the present swing, which begins now or did before, and return it."""
        stance = self.clock.stance_duration(foot, time)
        others = [(x, y) for other, (x, y, _) in enumerate(self.footholds.tolist()) if other != foot]
        remaining, width = max(touchdown - time, 0.0), self.clock.gait.width
        if self._headings:
            self.yaws[foot] = self._planner.heading(motion, remaining, stance)
        x, y = self._planner.place(foot, motion, remaining, stance, others, width)
        if self.shifts is not None:
            (ahead, left), c, s = self.shifts[foot].tolist(), math.cos(motion.yaw), math.sin(motion.yaw)
            x, y = x + c * ahead - s * left, y + s * ahead + c * left
        target: Vector = (x, y, self.ground.height_at(x, y))
        if self.mapped is not None:
            leeway = None if begins else self._swings[foot].leeway(time)
            target = self.mapped.aim(foot, time, self._planner, motion, (x, y), remaining, stance, others, leeway)
            if self._headings:  # two soles lead the robot: where the map moves them, it has to be
                x, y = self._planner.place(foot, motion.as_desired(), remaining, stance, others, width)
                self.drawn = target[0] - x, target[1] - y
        self._nominal[foot] = self.footholds[foot] = target
        return target

    def write_contacts(self, time: float, swing: Task, raising: float = 1.0) -> None:
        """Write what the QP takes of contacts and swings; ``raising`` is a factor on heights of feet that lag."""
        shares, airborne = bounds = self.events.loading(time), self.events.airborne(time)
        self._contacts.stance[...] = self.points.spread(self.stance & ~self.lost)
        if bounds != self._bounds or True in airborne:
            self._bounds = bounds
            self._bound_forces(shares, airborne)
        if not self.standing:
            target, spread = swing.target, self.points.spread
            target.velocity[...], target.acceleration[...] = spread(self.velocity), spread(self.acceleration)
            if self._headings:
                self._turn_soles(time, target.velocity, target.acceleration)
            target.position[...] = self.targets
            factors = [raising if path.unattainable else 1.0 for path in self._swings]
            swing.weight[2::3] = swing.weight[::3] * spread(factors)

    def _bound_forces(self, shares: list[float], airborne: list[bool]) -> None:
        """Write the bounds of normal forces: unloaded, a foot that bounced off stays in the air; loaded, it strikes."""
        contacts, lowest = self._contacts, self._lowest
        highest = np.multiply(shares, self._highest, out=contacts.highest_normal)
        if True in airborne:
            rising = (self._velocities * contacts.normals).sum(axis=1)[self.points.starts]
            press = self._press * np.clip(1.0 + rising / _FALLING, 0.0, 1.0)
            lowest = np.where(airborne, press, lowest)
            np.minimum(highest, press, out=highest, where=np.logical_and(airborne, self.events.brief))
        np.minimum(lowest, highest, out=contacts.lowest_normal)

    def _turn_soles(self, time: float, velocities: Array, accelerations: Array) -> None:
        """Write the targets of the soles' points, and add what they move by turning; soles lie along the ground."""
        yaws, rates, turning = np.array([heading.sample(time) for heading in self._headings]).T[:, self.points.of]
        arms = self.points.arms(np.where(self.stance, self.yaws, yaws[self.points.starts]), self.ground.normals)
        across = np.cross(self.ground.normals, arms)
        self.targets[...] = self.position[self.points.of] + arms
        velocities += rates[:, None] * across
        accelerations += turning[:, None] * across - (rates**2)[:, None] * arms

    def write_horizon(
        self, grid: TimeGrid, motion: BaseMotion, friction: float, horizon: ContactHorizon,
        clock: GaitClock | None = None,
    ) -> None:  # fmt: skip
        """Write flags, contact points and friction of the intervals of a horizon.

        The schedule is that of the feet, or of another clock.
        """
        feet, single = self.points, self.points.single
        horizon.normals[...] = self.ground.normals
        if clock is None and self.standing:
            points = feet.place(self.footholds, self.yaws, self.ground.normals)
            horizon.hold(points, feet.spread(self.stance), friction)
            return
        clock = self.clock if clock is None else clock
        flags = horizon.flags if single else np.empty((len(horizon.flags), feet.feet), dtype=np.bool_)
        centres = horizon.points if single else np.empty((*flags.shape, 3))
        clock.horizon(grid, flags)
        self.events.correct(flags, grid)
        points = np.where((self.stance | self._fixed(grid.start))[:, None], self.footholds, self._nominal)
        yaws = None if single else np.tile(self.yaws, (len(flags), 1))
        self._planner.horizon(clock, motion, grid, points, centres, self.stance.tolist(), yaws)
        if self.mapped is not None:
            stance_s = clock.gait.stance_s
            self.mapped.spread(self._planner, motion, grid, stance_s, points, centres, horizon.normals)
        if yaws is not None:
            horizon.flags[...], horizon.points[...] = flags[:, feet.of], feet.place(centres, yaws, horizon.normals)
        horizon.friction[:] = friction

    def write_leg_momentum(self, grid: TimeGrid, motion: MotionReference, contacts: ContactHorizon) -> None:
        """Write the angular momentum of the legs' motion along the contacts of a horizon, if feet are soles."""
        if self._inertias is None:
            return
        centres, yaw = contacts.points[:, self.points.starts], float(self.yaws.mean())
        given = self._inertias, yaw, self.clock, self._swings, centres, self.ground.normal
        motion.legs = None if self.standing else leg_momentum(*given, motion.com_velocity, grid)

    def _fixed(self, time: float) -> BoolArray:
        """Return (nc,) the feet in the air whose foothold does not change any more."""
        ends = [self.events.searching(foot) or path.frozen(time) for foot, path in enumerate(self._swings)]
        return ~self.stance & ends
