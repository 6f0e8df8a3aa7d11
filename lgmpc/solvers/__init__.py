"""Solvers of optimal control problems: real-time SQP on structured QPs, and ipopt as the offline reference."""

from lgmpc.solvers.nlp import IpoptSolver, NlpResult, NlpStatus
from lgmpc.solvers.sqp import SqpResult, SqpSolver, SqpStatus, SqpTimings

__all__ = ["IpoptSolver", "NlpResult", "NlpStatus", "SqpResult", "SqpSolver", "SqpStatus", "SqpTimings"]
