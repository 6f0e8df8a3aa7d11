"""Texts of the command line's help. A paragraph is one line: the terminal breaks it."""

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
  lgmpc sweep push_map         largest push from each side, with and without MPC
  lgmpc play latest            replay the last of them in the browser
  lgmpc demo                   list the demonstrations

[bold]Exit codes[/bold]  0 passed its gate, 1 ran and failed it, 2 bad input, 130 stopped by Ctrl-C, 70 error in lgmpc
"""


def examples(command: str) -> str:
    """Return the text after the options of a command: one paragraph for each line, so that none are joined."""
    paragraphs = {name: lines for name, *lines in (each.splitlines() for each in _EXAMPLES.split("\n\n"))}
    return "\n\n".join(["[bold]Examples[/bold]", *(f"  {line}" for line in paragraphs[command])])


_EXAMPLES = """\
run
lgmpc run solo12_balance
lgmpc run solo12_balance --set mpc.enabled=false --set plant.friction=0.4
lgmpc run solo12_balance --set "pushes.0.impulse_ns=[0, 3, 0]" --out /tmp/runs
lgmpc run solo12_stand --json | jq .metrics.max_tilt_deg
lgmpc run runs/<time>-<name>/config.yaml      repeat a run; `lgmpc compare` says whether bit for bit
lgmpc run runs/<time>-<name>/config.yaml "changes=[{at_s: 2.3, set: {plant.friction: 0.3}}]"
lgmpc run solo12_velocity --view              in real time, on a page in the browser

live
lgmpc live solo12_velocity
lgmpc live go2_velocity world=stairs_5cm
lgmpc live solo12_velocity_inekf --robot 127.0.0.1:47800     the robot of `lgmpc robot solo12_velocity_inekf`
lgmpc live solo12_velocity --no-browser     for another machine: ssh -L 8080:127.0.0.1:8080 user@this

solve
lgmpc solve solo12_trot
lgmpc solve solo12_trot --set problem.cycles=5 "problem.velocity_m_s=[0.2, 0.1]"
lgmpc solve panda_reach --set solver.method=ipopt gate.max_effort_ratio=0.9
lgmpc solve solo12_jump --json | jq .figures
lgmpc solve runs/<time>-<name>/config.yaml    repeat it

sweep
lgmpc sweep push_map
lgmpc sweep push_map --set "factors.1.values=[0.4, 0.5, 0.7]" --out /tmp/push_map --workers 2
lgmpc sweep ablation --set base=solo12_velocity    each part of the controller taken away, in pairs
lgmpc sweep random_1000 --set samples.count=50 --out /tmp/random --json | jq .groups
lgmpc sweep push_map --resume              continue after Ctrl-C
lgmpc sweep random_1000 --part 2/16 --out part_2    a sixteenth, as one of 16 machines

play
lgmpc play latest                          in the browser, with a time slider
lgmpc play latest --html balance.html      one self-contained page
lgmpc play latest --video balance.mp4      a film in real time; .gif too

export
lgmpc export latest --csv run.csv --parquet run.parquet
lgmpc export latest --csv updates.csv --table mpc
lgmpc export latest --mcap run.mcap --rrd run.rrd     for Foxglove and rerun
lgmpc export sweeps/random_1000 --dataset walks     the runs that it kept, for LeRobot
lgmpc export latest --c tick                        whole-body controller and MPC in C, for robots without Python

plot
lgmpc plot latest                          into the run's own folder, figures/
lgmpc plot runs/<time>-<name> --out /tmp/figures

explain
lgmpc explain latest                       why the last run failed, or its smallest margins
lgmpc explain sweeps/random_1000/logs/fail-<key>
lgmpc explain latest --json | jq -r '.events[] | [.start_s, .words] | @tsv'

report
lgmpc report latest                        report.html in the run's own folder
lgmpc report latest --html fall.html       a page that requires no installation
lgmpc report sweeps/push_map               tables, figure and points of a sweep

compare
lgmpc compare runs/<time>-a runs/<time>-b
lgmpc compare sweeps/before sweeps/after --margin 0.02 --metric max_tilt_deg
lgmpc compare sweeps/before sweeps/after --json | jq .quantities

demo
lgmpc demo                                 the list
lgmpc demo dzhanibekov                     a body that keeps turning over
lgmpc demo integrators --out /tmp/demo --no-view

check
lgmpc check solo12_balance
lgmpc check my.yaml --set robot.model=anymal_c
lgmpc check panda_reach                    which figures can be bounded

configs
lgmpc configs                              the list
lgmpc configs --copy solo12_balance my.yaml
lgmpc run my.yaml

doctor
lgmpc doctor
LGMPC_CACHE_DIR=/tmp/cache lgmpc doctor    with another compile cache; LGMPC_JIT=0 compiles nothing

schema
lgmpc schema > configs/schema.json
As first line of a config: # yaml-language-server: $schema=schema.json

deploy
lgmpc robot solo12_velocity_inekf                                 in one terminal: a robot in real time
lgmpc deploy solo12_velocity_inekf                                in another: its controller
lgmpc deploy solo12_balance_inekf --robot 192.168.1.20:47800      a robot whose driver uses the protocol

robot
lgmpc robot solo12_balance_inekf
lgmpc robot solo12_balance_inekf plant.friction=0.4 --port 47801
lgmpc robot solo12_balance_inekf --lock-step      at the pace of its controller, repeatable bit for bit
"""
"""A paragraph for each command, its name first."""
