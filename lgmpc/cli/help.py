"""Texts of the command line's help. A paragraph is one line: the terminal breaks it."""

from __future__ import annotations

__all__ = ["CHECK", "CONFIGS", "DEMO", "DOCTOR", "OVERVIEW", "PLAY", "PLOT", "RUN", "SCHEMA", "SOLVE"]

_WHAT = "Lie-group trajectory optimisation and model-predictive control of floating-base robots."
_HOW = (
    "A config (YAML) describes a robot, what counts as success, and either a plant, controllers and disturbances, "
    "which `lgmpc run` simulates, or a problem and a solver, whose trajectory `lgmpc solve` computes. Both save a run "
    "folder; `lgmpc play` and `lgmpc plot` show it. `lgmpc demo` needs no config: it compares predictions of geometric "
    "mechanics with simulations."
)
OVERVIEW = f"""{_WHAT}

{_HOW}

[bold]Start here[/bold]

  lgmpc doctor                 check the installation
  lgmpc configs                list the configs that come with lgmpc
  lgmpc run solo12_balance     push Solo12, see it recover
  lgmpc solve solo12_trot      optimise a trajectory
  lgmpc play latest            replay the last of them in the browser
  lgmpc demo                   list the demonstrations

[bold]Exit codes[/bold]  0 passed its gate, 1 ran and failed it, 2 bad input, 130 stopped by Ctrl-C, 70 mistake in lgmpc
"""


def _examples(*lines: str) -> str:
    """One paragraph for each command, so that none is joined with the next."""
    return "\n\n".join(["[bold]Examples[/bold]", *(f"  {line}" for line in lines)]) + "\n"


RUN = _examples(
    "lgmpc run solo12_balance",
    "lgmpc run solo12_balance --set mpc.enabled=false --set plant.friction=0.4",
    'lgmpc run solo12_balance --set "pushes.0.impulse_ns=[0, 3, 0]" --out /tmp/runs',
    "lgmpc run solo12_stand --json | jq .metrics.max_tilt_deg",
    "lgmpc run runs/<time>-<name>/config.yaml      repeat a run",
)
SOLVE = _examples(
    "lgmpc solve solo12_trot",
    'lgmpc solve solo12_trot --set problem.cycles=5 "problem.velocity_m_s=[0.2, 0.1]"',
    "lgmpc solve panda_reach --set solver.method=ipopt gate.max_effort_ratio=0.9",
    "lgmpc solve solo12_com_circle_full_body --json | jq .figures",
    "lgmpc solve runs/<time>-<name>/config.yaml    repeat it",
)
PLAY = _examples(
    "lgmpc play latest                          in the browser, with a time slider",
    "lgmpc play latest --html balance.html      one page that needs nothing else",
    "lgmpc play latest --port 7000              on a fixed port, such as one that ssh forwards",
)
PLOT = _examples(
    "lgmpc plot latest                          into the run's own folder, figures/",
    "lgmpc plot runs/<time>-<name> --out /tmp/figures",
)
DEMO = _examples(
    "lgmpc demo                                 the list",
    "lgmpc demo dzhanibekov                     a body that keeps turning over",
    "lgmpc demo integrators --out /tmp/demo --format svg --no-view",
)
CHECK = _examples(
    "lgmpc check solo12_balance",
    "lgmpc check my.yaml --set robot.model=anymal_c",
    "lgmpc check panda_reach                    which figures can be bounded",
)
CONFIGS = _examples(
    "lgmpc configs                              the list",
    "lgmpc configs --copy solo12_balance my.yaml",
    "lgmpc run my.yaml",
)
DOCTOR = _examples(
    "lgmpc doctor",
    "LGMPC_CACHE_DIR=/tmp/cache lgmpc doctor    with another compile cache; LGMPC_JIT=0 compiles nothing",
)
SCHEMA = (
    _examples("lgmpc schema --out configs/schema.json")
    + """
As first line of a config: # yaml-language-server: $schema=schema.json
"""
)
