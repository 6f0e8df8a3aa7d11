"""The groups on CasADi expressions (SX, MX, DM), one element a call; names and conventions of :mod:`lgmpc.lie`.

Arguments are not validated. Branches are guarded, so that derivatives of any order are exact at the identity.
"""

from lgmpc.lie.symbolic import quaternion as quaternion, so3 as so3
from lgmpc.lie.symbolic.poses import Poses as Poses

se3 = Poses(linear_first=True)
"""SE(3): homogeneous matrices (4, 4), twists (6) linear first."""
sek3 = Poses()
"""SE_k(3): matrices (3 + k, 3 + k), tangents (3 + 3k) rotation first."""
