"""The two kinds of documents: the config of a closed loop, and that of a trajectory to optimise.

A document composes the packages' own settings and checks the conditions between them. It stores the sources of its
values (file and line, or ``--set``) for messages. Units are in the keys' names.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, TypeVar, Union

from pydantic import Field, PrivateAttr, model_validator
from pydantic.json_schema import models_json_schema

from lgmpc.control.drives import DriveSettings
from lgmpc.control.modes import ModeSettings
from lgmpc.control.reference import CircleReference, StandReference
from lgmpc.errors import ConfigError, InputError, nearest
from lgmpc.estimation import DelaySettings, JointFaultSettings, JointFrictionSettings, LeggedEstimatorSettings
from lgmpc.hardware.safety import DeploymentSettings
from lgmpc.locomotion.command import Timeline
from lgmpc.locomotion.settings import LocomotionSettings
from lgmpc.mpc import AnyMpcSettings, CentroidalMpcSettings
from lgmpc.problems import AnyProblemSettings
from lgmpc.robot import RobotSpec
from lgmpc.runs import Gate, LogSettings, SolveGate
from lgmpc.settings import NonNegative, Positive, Problem, Settings, Words, key, problem, problems
from lgmpc.settings.dotted import leaves
from lgmpc.simulation.disturbances import Push
from lgmpc.simulation.drives import TimingSettings
from lgmpc.simulation.parameters import PlantSettings
from lgmpc.simulation.sensors import SensorNoise
from lgmpc.solvers import AnySolverSettings, FddpSettings
from lgmpc.timegrid import periods_in
from lgmpc.wbc import WholeBodySettings
from lgmpc.world import FloorSettings, WorldSettings

COMMAND_LINE = "--set"
"""Source of a value given on the command line."""


@dataclass(frozen=True)
class ConfigSource:
    """Sources of a config's values. Two of them always compare equal, so that configs compare by their values.

    Attributes:
        file: name of the config file.
        places: dotted key to "file:line" or "--set".
    """

    file: str = field(compare=False)
    places: Mapping[str, str] = field(default_factory=dict, compare=False)

    def where(self, key: str) -> str:
        """Return the place of ``key``, or of the innermost section around it that has one."""
        while key:
            if key in self.places:
                return self.places[key]
            key = key.rpartition(".")[0]
        return self.file


MOST_TICKS = 3_600_000
"""Ticks of the longest run: an hour at 1 kHz, whose log takes 4 GB."""

D = TypeVar("D", bound="Document")

WHILE_RUNNING = ("seed", "plant", "timing", "sensors", "estimator", "mpc", "wbc", "reference", "locomotion", "delays",
                  "joint_friction", "modes")  # fmt: skip
"""Sections that can change during a run."""
_FROM_THE_START = ("wbc.rate_hz", "plant.kind", "plant.rate_hz", "plant.initial_", "estimator.kind",
                    "locomotion.terrain.map")  # fmt: skip
"""Beginnings of their keys that cannot, because they act at its start or determine its time grid and its channels."""


class Document(Settings):
    """A whole config file."""

    name: str = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$",
        max_length=80,
        description="Name of the run; part of its folder's name, so letters, digits, '.', '_' and '-' only.",
    )
    robot: RobotSpec = Field(description="The robot.")

    _source: ConfigSource = PrivateAttr(default_factory=lambda: ConfigSource("config"))

    @property
    def source(self) -> ConfigSource:
        """The source of each key's value."""
        return self._source

    def with_source(self: D, source: ConfigSource) -> D:
        """Return an equal copy with the sources of its values."""
        copy = self.model_copy()
        copy._source = source
        return copy

    def replace(self: D, changes: Mapping[str, Any]) -> D:
        """Return a checked copy with some values changed and the same sources; see :meth:`Settings.replace`."""
        return super().replace(changes).with_source(self.source)

    def error(
        self, key: str, got: object, expected: str, choices: Sequence[str] = (), *, word: str | None = None
    ) -> ConfigError:
        """Return the error for a key whose value proved unusable after the checks, with its file and line.

        Arguments as in :class:`lgmpc.errors.ConfigError`.
        """
        return ConfigError(self.source.where(key), key, got, expected, choices, word=word)


class Change(Settings):
    """Settings that act from some time of a run on."""

    at_s: Positive = Field(description="Time of the change, s, rounded to a control tick.")
    set: dict[str, Any] = Field(
        min_length=1, description="{dotted key: value}, such as {plant.friction: 0.3, mpc.enabled: false}."
    )


class ManeuverSource(Settings):
    """A planned motion: a problem that is solved before the loop begins, or the run of one that has been solved."""

    problem: str | None = key(None, "Config of the problem: a file, or the name of a shipped one such as solo12_jump.")
    set: dict[str, Any] = key({}, "Changes of that config, {dotted key: value}, such as {problem.yaw_deg: 90}.")
    run: str | None = key(None, "Run folder of a solved problem, in place of a problem.")
    anchor: Literal["feet", "world"] = key(
        "feet",
        "feet: performed wherever the robot stands; world: where it was planned, to where the robot walks first.",
    )

    @model_validator(mode="after")
    def _one_of_both(self) -> "ManeuverSource":
        if (self.problem is None) is (self.run is None):
            raise problem("either problem or run", "run", self.run)
        if self.run is not None and self.set:
            raise problem("none with a run: they are changes of a problem's config", "set", self.set)
        return self


class GroundTruth(Settings):
    """No estimator: the controllers receive the simulator's state."""

    kind: Literal["ground_truth"] = key("ground_truth", "The simulator's exact state.")


class Config(Document):
    """A closed loop: robot, plant, controllers, commands, and criteria of success."""

    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = key(0, "Seed of all random numbers.")
    duration_s: Positive = key(10.0, "Simulated time, s.")
    after_fall_s: NonNegative | None = key(0.5, "Simulated time after a fall at which the run ends, s; null: never.")
    world: WorldSettings = key(FloorSettings(), "The ground, and where the robot starts on it.")
    plant: PlantSettings = key(PlantSettings(), "The plant: physics engine, simulated robot.")
    timing: TimingSettings = key(TimingSettings(), "Simulated duration of the computations.")
    sensors: SensorNoise = key(SensorNoise(), "Errors of the simulated robot's sensors.")
    estimator: Annotated[Union[GroundTruth, LeggedEstimatorSettings], Field(discriminator="kind")] = Field(  # noqa: UP007
        default=GroundTruth(), description="Source of the controllers' state."
    )
    mpc: AnyMpcSettings = key(CentroidalMpcSettings(), "The predictive controller.")
    wbc: WholeBodySettings = key(WholeBodySettings(), "The whole-body controller.")
    reference: Annotated[Union[StandReference, CircleReference], Field(discriminator="kind")] = Field(  # noqa: UP007
        default=StandReference(), description="Motion of the centre of mass relative to the commanded one."
    )
    commands: Timeline = key((), "Motion commands over time; none: stand.")
    maneuvers: dict[str, ManeuverSource] = key({}, "Planned motions by name; commands call them by their key maneuver.")
    locomotion: LocomotionSettings = key(LocomotionSettings(), "Gaits and steps.")
    delays: DelaySettings = key(DelaySettings(), "Delays that the controller compensates.")
    joint_friction: JointFrictionSettings | None = key(
        None, "Estimation of the joints' friction while legs swing; null: that of the model is used."
    )
    joint_faults: JointFaultSettings | None = key(
        JointFaultSettings(),
        "Detection of weak and dead motors by the motion of the robot, with point feet on legs of three "
        "joints; null: none.",
    )
    drives: DriveSettings = key(DriveSettings(), "Gains of the drives' own loop, which holds the motion between ticks.")
    modes: ModeSettings = key(ModeSettings(), "Lying, rising, damping after a fall, recovery.")
    deployment: DeploymentSettings = key(DeploymentSettings(), "Limits of `lgmpc deploy`, which drives a robot.")
    pushes: tuple[Push, ...] = key((), "Disturbances.")
    changes: tuple[Change, ...] = key(
        (),
        "Settings that change during the run, in order of time. New controllers, estimators and sensors "
        "receive all that happened before, so that they continue from where the others are.",
    )
    gate: Gate = key(Gate(), "Criteria of success.")
    log: LogSettings = key(LogSettings(), "Settings of the saved log.")

    @property
    def log_every(self) -> int:
        """Number of control ticks per logged tick."""
        return periods_in("log.rate_hz", self.log.rate_hz, "wbc.rate_hz", self.wbc.rate_hz)

    @model_validator(mode="after")
    def _rates_divide(self) -> "Config":
        """Check that every rate is a faster one divided by a whole number: the loop counts plant steps."""
        pairs = [
            ("wbc.rate_hz", self.wbc.rate_hz, "plant.rate_hz", self.plant.rate_hz),
            ("log.rate_hz", self.log.rate_hz, "wbc.rate_hz", self.wbc.rate_hz),
        ]
        if self.mpc.enabled:
            pairs.append(("mpc.rate_hz", self.mpc.rate_hz, "wbc.rate_hz", self.wbc.rate_hz))
        found = []
        for name, slow, fast_key, fast in pairs:
            try:
                periods_in(name, slow, fast_key, fast)
            except InputError as error:
                found.append(Problem(name, slow, error.expected))
        if self.commands and not self.mpc.enabled:
            words = "true if there are commands: without a plan the robot only stands"
            found.append(Problem("mpc.enabled", False, words))
        if found:
            raise problems(found)
        return self

    def parts(self) -> "tuple[tuple[float, Config], ...]":
        """Return the beginning, s, and the config of each part of the run: before the first change, after it, ...

        Raises:
            InputError: a value that cannot be used; names its key.
        """
        found: list[tuple[float, Config]] = [(0.0, self.replace({"changes": ()}) if self.changes else self)]
        for change in self.changes:
            found.append((change.at_s, found[-1][1].replace(change.set)))
        return tuple(found)

    @model_validator(mode="after")
    def _changes_can_be_made(self) -> "Config":
        part, last = self.replace({"changes": ()}) if self.changes else self, 0.0
        half = 0.5 / self.wbc.rate_hz
        for i, change in enumerate(self.changes):
            if not last + half < change.at_s < self.duration_s - half:
                words = f"a time after {last:g} s and before duration_s ({self.duration_s:g})"
                raise problem(words, key=f"changes.{i}.at_s", got=change.at_s)
            table = f"changes.{i}.set"
            for name, value in leaves(change.set):
                if name.split(".")[0] not in WHILE_RUNNING or name.startswith(_FROM_THE_START):
                    words = f"no change during a run, as of {_changeable(part, name)}"
                    raise problem(words, f"{table}.{name}", Words(value))
            try:
                following = part.replace(change.set)
            except InputError as error:
                words = str(error).partition("; expected ")[2]
                raise problem(words, f"{table}.{error.argument}", Words(error.got)) from None
            nodes = [each.mpc.nodes for each in (part, following) if each.mpc.enabled]
            if len(set(nodes)) > 1:
                words = f"{nodes[0]}, because a log has horizons of one length"
                raise problem(words, f"{table}.mpc.nodes", nodes[1])
            if (part.joint_friction is None) is not (following.joint_friction is None):
                words = "estimated from the start or never, because a log has the same channels throughout"
                raise problem(words, f"{table}.joint_friction", Words(change.set.get("joint_friction")))
            part, last = following, change.at_s
        return self

    @model_validator(mode="after")
    def _has_ticks(self) -> "Config":
        """Check the number of ticks, all of which are recorded in memory."""
        ticks, rate = self.duration_s * self.wbc.rate_hz, self.wbc.rate_hz
        if not 0.5 < ticks <= MOST_TICKS:
            expected = f"a number from {1.0 / rate:g} to {MOST_TICKS / rate:g}, at a wbc.rate_hz of {rate:g}"
            raise problem(expected, key="duration_s", got=self.duration_s)
        return self


def _changeable(config: Config, key: str) -> str:
    """Return the keys nearest to a key, or the sections, that can change during a run."""
    keys = [each for each, _ in leaves(config.model_dump(mode="json")) if each.partition(".")[0] in WHILE_RUNNING]
    close = nearest(key, [each for each in keys if not each.startswith(_FROM_THE_START)])
    return " or ".join(close) if close else f"one in {', '.join(WHILE_RUNNING)}"


class SolveConfig(Document):
    """A trajectory to optimise: robot, problem, solver, and criteria of success."""

    problem: AnyProblemSettings = Field(description="The optimal control problem.")
    solver: AnySolverSettings = key(FddpSettings(), "The solver.")
    gate: SolveGate = key(SolveGate(), "Criteria of success.")


def json_schema_text() -> str:
    """Return the JSON schema of both kinds of configs, :class:`Config` and :class:`SolveConfig`, as text."""
    _, definitions = models_json_schema([(Config, "validation"), (SolveConfig, "validation")])
    either = [{"$ref": f"#/$defs/{root.__name__}"} for root in (Config, SolveConfig)]
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "anyOf": either, **definitions}
    return json.dumps(schema, indent=2) + "\n"
