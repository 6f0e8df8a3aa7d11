"""Reduction by symmetry: systems on any matrix group, their equations, brackets and conserved momenta."""
