"""Notes on valid configs whose values were probably not intended."""

from __future__ import annotations

from lgmpc.config.schema import Config, GroundTruth
from lgmpc.simulation.sensors import SensorNoise

__all__ = ["notes_on"]


def notes_on(config: Config) -> tuple[str, ...]:
    """Return one sentence for each setting of ``config`` that was probably not intended."""
    notes = []
    for i, push in enumerate(config.pushes):
        if push.time_s >= config.duration_s:
            notes.append(f"pushes.{i} begins at {push.time_s:g} s, after the end of the run ({config.duration_s:g} s)")
        elif push.time_s + push.duration_s > config.duration_s:
            notes.append(f"pushes.{i} is cut short by the end of the run ({config.duration_s:g} s)")
    if config.gate.steady_from_s >= config.duration_s:
        notes.append("gate.steady_from_s is after the end of the run: steady errors are not measured")
    if isinstance(config.estimator, GroundTruth) and config.sensors != SensorNoise():
        notes.append("sensors: not used while estimator.kind is ground_truth")
    for section, friction in (("wbc", config.wbc.friction), ("mpc", config.mpc.friction)):
        if friction > config.plant.friction and (section == "wbc" or config.mpc.enabled):
            notes.append(
                f"{section}.friction ({friction:g}) is above the floor's ({config.plant.friction:g}): feet may slip"
            )
    return tuple(notes)
