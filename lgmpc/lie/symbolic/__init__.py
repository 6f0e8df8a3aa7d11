"""The groups on CasADi expressions (SX, MX, DM), one element a call; names and conventions of :mod:`lgmpc.lie`.

Arguments are not validated. Branches are guarded, so that derivatives of any order are exact at the identity.
"""

from lgmpc.lie.symbolic import quaternion, so3
from lgmpc.lie.symbolic.poses import se3, sek3

__all__ = ["quaternion", "se3", "sek3", "so3"]
