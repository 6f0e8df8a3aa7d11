"""The config of a closed loop: all sections, and the conditions between them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from lgmpc.config.schema.document import Document
from lgmpc.config.schema.estimator import EstimatorSection, GroundTruth
from lgmpc.config.schema.log import LogSection
from lgmpc.config.schema.plant import PlantSection
from lgmpc.config.schema.pushes import PushSection
from lgmpc.config.schema.reference import ReferenceSection, StandReference
from lgmpc.config.schema.sensors import SensorsSection
from lgmpc.config.schema.wbc import WbcSection
from lgmpc.mpc import AnyMpcSettings, CentroidalMpcSettings
from lgmpc.runs.gate import Gate
from lgmpc.settings import Positive, Problem, problem, problems

__all__ = ["MOST_TICKS", "Config"]

MOST_TICKS = 3_600_000
"""Ticks of the longest run: an hour at 1 kHz, which takes 4 GB."""


class Config(Document):
    """A closed loop: a robot, its world, its controllers, what it should do, and what counts as success."""

    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = Field(
        default=0, description="Seed of all random numbers."
    )
    duration_s: Positive = Field(default=10.0, description="Simulated time, s.")
    plant: PlantSection = Field(default=PlantSection(), description="The simulated world.")
    sensors: SensorsSection = Field(default=SensorsSection(), description="How the simulated robot's sensors err.")
    estimator: EstimatorSection = Field(default=GroundTruth(), description="How the controllers learn the state.")
    mpc: AnyMpcSettings = Field(default=CentroidalMpcSettings(), description="The predictive controller.")
    wbc: WbcSection = Field(default=WbcSection(), description="The whole-body controller.")
    reference: ReferenceSection = Field(default=StandReference(), description="What the robot should do.")
    pushes: tuple[PushSection, ...] = Field(default=(), description="Disturbances.")
    gate: Gate = Field(default=Gate(), description="What counts as success.")
    log: LogSection = Field(default=LogSection(), description="What is recorded.")

    @model_validator(mode="after")
    def _rates_divide(self) -> Config:
        """The loop counts plant steps, so every slower rate must come after a whole number of faster ticks."""
        pairs = [
            ("wbc.rate_hz", self.wbc.rate_hz, "plant.rate_hz", self.plant.rate_hz),
            ("log.rate_hz", self.log.rate_hz, "wbc.rate_hz", self.wbc.rate_hz),
        ]
        if self.mpc.enabled:
            pairs.append(("mpc.rate_hz", self.mpc.rate_hz, "wbc.rate_hz", self.wbc.rate_hz))
        found = []
        for key, slow, fast_key, fast in pairs:
            ratio = fast / slow
            if ratio < 1.0 - 1e-9 or abs(ratio - round(ratio)) > 1e-9 * ratio:
                found.append(Problem(key, slow, f"{fast_key} ({fast:g}) divided by a whole number"))
        if found:
            raise problems(found)
        return self

    @model_validator(mode="after")
    def _has_ticks(self) -> Config:
        """Every tick of the whole-body controller is recorded, in memory."""
        ticks, rate = self.duration_s * self.wbc.rate_hz, self.wbc.rate_hz
        if not 0.5 < ticks <= MOST_TICKS:
            expected = f"a number from {1.0 / rate:g} to {MOST_TICKS / rate:g}, at a wbc.rate_hz of {rate:g}"
            raise problem(expected, key="duration_s", got=self.duration_s)
        return self
