"""Geometric mechanics on matrix Lie groups: equations of motion, invariants, integrators, phases and control."""
