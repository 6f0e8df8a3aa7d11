"""CasADi twins of the groups: same names and conventions as :mod:`lgmpc.lie`, for SX, MX and DM, one element a call.

Nothing is checked: arguments are expressions. Branches are guarded, so derivatives of any order are exact at the
identity.
"""

from lgmpc.lie.symbolic import quaternion, se3, sek3, so3

__all__ = ["quaternion", "se3", "sek3", "so3"]
