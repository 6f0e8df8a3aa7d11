"""Spinning bodies in closed form: torque-free, Poinsot's construction, Lagrange's top; and benchmarks."""
