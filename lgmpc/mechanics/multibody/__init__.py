"""Robots: equations of motion derived from energies, centroidal momentum."""

from lgmpc.mechanics.multibody.articulated import ArticulatedBody, Kinematics, Link
from lgmpc.mechanics.multibody.centroidal import CentroidalTerms, centroidal_terms, wrench_about
from lgmpc.mechanics.multibody.floating_base import EquationsOfMotion, FloatingBaseDynamics

__all__ = [
    "ArticulatedBody",
    "CentroidalTerms",
    "EquationsOfMotion",
    "FloatingBaseDynamics",
    "Kinematics",
    "Link",
    "centroidal_terms",
    "wrench_about",
]
