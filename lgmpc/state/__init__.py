"""State spaces: where trajectories live, and how to move and measure on them."""

from lgmpc.state.configuration import difference_symbolic, integrate_configuration_symbolic

__all__ = ["difference_symbolic", "integrate_configuration_symbolic"]
