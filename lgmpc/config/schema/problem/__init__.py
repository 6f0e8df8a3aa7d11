"""Config section ``problem``: what is optimised. One module a kind; :mod:`lgmpc.config.scenarios` builds them."""

from typing import Annotated, Union

from pydantic import Field

from lgmpc.config.schema.problem.com_circle import ComCircleProblem
from lgmpc.config.schema.problem.reach import ReachProblem

__all__ = ["ComCircleProblem", "ProblemSection", "ReachProblem"]

ProblemSection = Annotated[
    Union[  # noqa: UP007 (evaluated at run time)
        ComCircleProblem,
        ReachProblem,
    ],
    Field(discriminator="kind"),
]
"""One kind of problem, chosen by the key ``kind``."""
