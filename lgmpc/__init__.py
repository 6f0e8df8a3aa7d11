"""lgmpc: Lie-group trajectory optimisation and model-predictive control for floating-base robots.

Conventions, one each, everywhere in the package:

* Configuration ``q = [base position (world), quaternion x y z w, joints]``; velocity
  ``v = [base linear, base angular (both in the body frame), joint rates]``: Pinocchio's.
* State ``x = (q, v)``: ``nx = nq + nv``, ``ndx = 2 nv``. ``diff(x0, x1) = x1 (-) x0``, ``integrate(x, dx) = x (+) dx``.
* SE(3) twists and wrenches are linear first. Extended poses SE_k(3) have tangent (rotation, then a 3-vector a column).
* ``coadjoint(xi) = ad(xi)^T``; ``force_cross(xi) = -ad(xi)^T``.
* Contact forces are in world axes and act on the robot. Centroidal momentum is ``[linear; angular]`` about the centre
  of mass in world axes.
* SI units. Random numbers come only from a ``numpy.random.Generator`` that is passed in.
"""

__version__ = "0.2.0"
