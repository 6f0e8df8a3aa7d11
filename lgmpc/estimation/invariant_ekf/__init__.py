"""Contact-aided invariant extended Kalman filter on SE_{2+k}(3), and the quaternion filter for comparison."""

from lgmpc.estimation.invariant_ekf.filter import InvariantEkf, chi_square_bound
from lgmpc.estimation.invariant_ekf.forms import FORMS, LEFT, MULTIPLICATIVE, RIGHT, ErrorForm

__all__ = ["FORMS", "LEFT", "MULTIPLICATIVE", "RIGHT", "ErrorForm", "InvariantEkf", "chi_square_bound"]
