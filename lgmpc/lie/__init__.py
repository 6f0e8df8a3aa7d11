"""Lie groups of rigid motion: SO(3), SE(3) and the extended poses SE_k(3).

* :mod:`lgmpc.lie.so3`, :data:`lgmpc.lie.se3`, :data:`lgmpc.lie.sek3`: numpy, single or batched over leading axes;
  :mod:`lgmpc.lie.quaternion`: the double cover of SO(3), x y z w; :mod:`lgmpc.lie.attitude`: angles.
* :mod:`lgmpc.lie.symbolic`: the same functions on CasADi expressions (``symbolic.so3``, ...).

Conventions: SE(3) twists and wrenches linear first, SE_k(3) tangents rotation first. ``coadjoint(xi) = ad(xi)^T`` and
``force_cross(xi) = -ad(xi)^T``. Left Jacobian: ``exp(xi + e) = exp(J e) exp(xi)``; right: ``exp(xi) exp(J e)``.
Logarithms return rotation vectors of norm at most pi; at exactly pi, the one with positive first non-zero entry.
"""

from lgmpc.lie import attitude as attitude, quaternion as quaternion, so3 as so3
from lgmpc.lie.groups import se3 as se3, sek3 as sek3
