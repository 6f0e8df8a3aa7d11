"""Contact-aided invariant extended Kalman filter on SE_{2+k}(3), and the quaternion filter for comparison."""

from lgmpc.estimation.invariant_ekf.filter import InvariantEkf as InvariantEkf, chi_square_bound as chi_square_bound
from lgmpc.estimation.invariant_ekf.forms import (
    FORMS as FORMS,
    LEFT as LEFT,
    MULTIPLICATIVE as MULTIPLICATIVE,
    RIGHT as RIGHT,
    ErrorForm as ErrorForm,
)
