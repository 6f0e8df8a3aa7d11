"""Outcomes of solvers, one vocabulary for all of them; the value of each is the remedy."""

from enum import Enum


class Status(Enum):
    """The outcome of a solve of any kind: a trajectory, a quadratic programme, an update of a predictive controller.

    Members say the remedy in their values.
    """

    CONVERGED = "nothing to do"
    ACCEPTABLE = "nothing to do if the accuracy is enough; else reduce the spread of the weights, or iterate more"
    STEPPED = "nothing to do: the requested iterations were taken"
    ITERATION_LIMIT = "raise max_iterations, start closer to the solution, or reduce the spread of the weights"
    TIME_LIMIT = "raise time_limit, or start closer to the solution"
    PRECISION_LIMIT = "rounding errors exceed the decrease: loosen the tolerance, or reduce the spread of the weights"
    STOPPED = "nothing to do: the callback requested the stop"
    STALLED = "no step lowers the cost: change the guess, shorten the intervals, or reduce the spread of the weights"
    DIVERGED = "steps of any length diverge: change the guess, or shorten the intervals"
    SADDLE = "stationary, but no minimum, as costs of negative weight have it: give weights that are not negative"
    INFEASIBLE = "no point nearby satisfies the constraints: check bounds, targets and first state for contradictions"
    UNBOUNDED = "the cost falls without limit: give all controls, and states that it rewards, weights or bounds"
    NOT_FINITE = "check guess, first state, parameters and the action's expressions for NaN, infinity and division by 0"
    FAILED = "the underlying solver failed: reduce the spread of the weights, or change the guess"
    STALE = "several updates in a row failed: do not follow the plan, balance without it; see how the first one failed"

    @property
    def remedy(self) -> str:
        """The remedy."""
        return self.value

    @property
    def solved(self) -> bool:
        """True if the requested conditions hold."""
        return self in (Status.CONVERGED, Status.ACCEPTABLE)

    @property
    def usable(self) -> bool:
        """True if there is a result at all, perhaps a rough one: no contradiction, no NaN, no failure."""
        return self not in (Status.INFEASIBLE, Status.UNBOUNDED, Status.NOT_FINITE, Status.FAILED, Status.STALE)
