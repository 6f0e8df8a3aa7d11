"""Configs that tests of several packages share."""

ARM = """\
name: arm
robot: {model: double_pendulum, effort_limit_nm: 2.0, velocity_limit_rad_s: 20.0, position_limit_rad: [-3.0, 3.0]}
problem: {kind: reach, frame: link2, position_m: [0.0290872, 0.06, 0.115], nodes: 20, node_s: 0.02}
solver: {method: box_fddp}
gate: {max_position_error_m: 0.002, max_effort_ratio: 1.0}
"""
"""A problem that is solved, compiled and drawn quickly."""
