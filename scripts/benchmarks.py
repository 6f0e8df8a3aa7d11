"""Run all benchmarks and write their figures into the documentation.

Every benchmark writes its figures as JSON (``--json``); those that the pages show are kept in
``docs/project/benchmarks.json``, each group with its command, date, machine and versions. The tables of
``docs/project/benchmarks.md`` and of ``README.md``, between ``<!-- table: NAME -->`` and ``<!-- /table -->``, are those
of ``scripts/benchmark_tables.md`` with these figures in place of ``{group.figure}``; the prose is written by hand.

    python scripts/benchmarks.py                    # everything: an hour or so, on a machine that does nothing else
    python scripts/benchmarks.py --only loop wbc    # these groups; the others keep their figures and dates
    python scripts/benchmarks.py --quick            # everything coarsely, some minutes: printed, nothing is written
    python scripts/benchmarks.py --pages            # nothing is measured: the pages anew, after a change of tables

Crocoddyl, for the group ``optimiser``, needs an environment of its own (extra ``bench``):

    .venv-bench/bin/python scripts/benchmarks.py --only optimiser
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
FILE = ROOT / "docs" / "project" / "benchmarks.json"
PAGES = (ROOT / "docs" / "project" / "benchmarks.md", ROOT / "README.md")
TEMPLATES = ROOT / "scripts" / "benchmark_tables.md"
TABLE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- /table -->)", re.DOTALL)
PLACE = re.compile(r"\{([\w.]+)(?::([^}]*))?\}")

Figures = dict[str, Any]


@dataclass(frozen=True)
class Group:
    """Figures that one command measures.

    Attributes:
        command: script and arguments.
        quick: arguments of a coarse measurement, in place of those.
        shown: from the script's figures to those that the pages show, numbers in nested tables.
    """

    command: str
    quick: str
    shown: Callable[[Any], Figures]


def slug(text: str) -> str:
    """Return a name as a part of a placeholder."""
    return re.sub(r"\W+", "_", text).strip("_")


def of_runs(found: Mapping[str, Any]) -> Figures:
    """Displacements of the base and of the feet, and how well a command was followed."""
    figures: Figures = {}
    for name, metrics in found.items():
        walking = metrics["walking"] or {}
        figures[slug(name)] = {
            "fate": "falls" if metrics["fell"] else "stays up",
            "base_mm": 1e3 * metrics["max_displacement_m"],
            "feet_mm": 1e3 * metrics["max_foot_displacement_m"],
            "saturated_percent": 1e2 * metrics["torque_saturation_fraction"],
            **_walked(walking),
        }
    return figures


def _walked(walking: Mapping[str, Any]) -> Figures:
    """Figures of walking, if there are any."""
    names = {"rmse_mm_s": ("velocity_rmse_m_s", 1e3), "raw_mm_s": ("raw_velocity_rmse_m_s", 1e3)}
    names |= {"tilt_deg": ("walking_tilt_deg", 1.0), "cost_of_transport": ("cost_of_transport", 1.0)}
    return {short: scale * walking[name] for short, (name, scale) in names.items() if walking.get(name) is not None}


def of_pushes(found: list[Any]) -> Figures:
    """Largest pushes by friction (in percent) and controller, over directions."""
    figures: Figures = {}
    for each in found:
        figures[f"mu{round(1e2 * each['friction'])}"] = {
            name: {"median_ns": float(np.median(pushes["stay_ns"])), "least_ns": min(pushes["stay_ns"])}
            for name, controller in (("alone", "whole-body QP"), ("mpc", "MPC + whole-body QP"))
            if (pushes := each["controllers"].get(controller)) is not None
        }
    return figures


def of_locomotion(found: Mapping[str, Any]) -> Figures:
    """Velocities and the largest pushes towards ahead, left, back, right."""
    figures: Figures = {}
    for row in found["velocities"]:
        limit = {"saturated_percent": 1e2 * row["torque_saturation_fraction"]}
        figures[slug(row["command"])] = _walked(row) | limit
    for name, pushed in zip(("trotting", "standing"), found.get("pushes", ()), strict=False):
        for kind in ("survived", "recovered"):
            least = np.min(pushed[f"{kind}_ns"], axis=1)  # of the phases
            figures.setdefault(name, {})[kind] = dict(zip(("ahead", "left", "back", "right"), least, strict=False))
    return figures


def of_loop(found: Mapping[str, Any]) -> Figures:
    """Times of an update, a tick and its parts."""
    return {
        "update": found["MPC update"],
        "tick": found["whole-body tick"],
        "real_time_factor": found["real-time factor"],
        "plant_step_us": found["parts"]["plant step"]["us_a_tick"],
        "interpreter_percent": 1e2 * found["parts"]["interpreter"]["share"],
    }


def of_wbc(found: Mapping[str, Any]) -> Figures:
    """Times of a tick with the cone's facets of the default settings."""
    figures = found["solo12"]["12"]
    return {**figures["tick_us"], "ticks_by_proxqp": figures["ticks_by_proxqp"]}


def of_mpc(found: Mapping[str, Any]) -> Figures:
    """Times of an update with the solver that is measured, ms."""
    (figures,) = found.values()
    return {"p50": figures["p50"], "p99": figures["p99"]}


def of_estimation(found: Mapping[str, Any]) -> Figures:
    """Times of the right-invariant filter's steps."""
    return {"predict_us": found["predict, right"]["p50"], "correct_us": found["correct, right"]["p50"]}


def of_actions(found: Mapping[str, Any]) -> Figures:
    """Times of a stage, scalar and in lanes."""
    return {
        label: {
            "instructions": each["instructions"],
            "one_us": each["one by one"]["median_us"],
            "lanes_us": each["in lanes"]["median_us"],
        }
        for label, each in found.items()
    }


def of_optimiser(found: list[Any]) -> Figures:
    """Times of an FDDP iteration by problem and library, and of an SQP iteration by QP solver."""
    figures: Figures = {}
    for each in found:
        problem, solver = slug(each["problem"]), each["solver"]
        if each["part"] == "solve":
            figures.setdefault(problem, {})[f"{solver}_ms"] = each["median_ms"] / each["iterations"]
        elif each["part"].startswith("iteration"):
            figures.setdefault(problem, {}).setdefault(solver, []).append(each["median_ms"])
    for each in figures.values():
        if "crocoddyl_ms" in each:
            each["ratio"] = each["lgmpc_ms"] / each["crocoddyl_ms"]
        for solver in [solver for solver, value in each.items() if isinstance(value, list)]:
            times = each.pop(solver)
            each[solver] = {"mean_ms": float(np.mean(times)), "first_ms": times[0]}
    return figures


def of_compilation(found: Mapping[str, Any]) -> Figures:
    """Processor time of the compiler by robot and step."""
    return {
        robot: {slug(name): {"s": step["compiler_s"], "libraries": step["libraries"]} for name, step in steps.items()}
        for robot, steps in found.items()
    }


def _pushes_with(options: str) -> Group:
    several = f"push_recovery.py {options} --directions"
    return Group(f"{several} 4 --resolution 0.1", f"{several} 1 --resolution 4.0", of_pushes)


def _set(*keys: str) -> str:
    return " ".join(f"--set {key}" for key in keys)


def _updates(model: str) -> Group:
    options = f"bench_mpc.py --model {model} --solvers active_set"
    return Group(options, f"{options} --seconds 0.8", of_mpc)


_LATE, _NOISY = "plant.link.command_latency_s=0.009", "plant.link.base_velocity_noise_m_s=0.03"
_RUBBING, _SLOW = "plant.joint_friction_nm=0.1", "mpc.observer_time_s=0.05"
_FRICTIONS = "push_recovery.py --friction 0.4 0.5 0.6 0.7"
GROUPS: dict[str, Group] = {
    "runs": Group("bench_runs.py", "bench_runs.py --only solo12_balance", of_runs),
    "pushes": Group(_FRICTIONS, "push_recovery.py --directions 1 --resolution 2.0", of_pushes),
    **{f"pushes_{model}": _pushes_with(f"--model {model}") for model in ("centroidal", "full_body")},
    "late": _pushes_with(_set(_LATE)),
    "late_compensated": _pushes_with(_set(_LATE, "delays.command_s=0.009")),
    "late_slow": _pushes_with(_set(_LATE, _SLOW)),
    "slow": _pushes_with(_set(_SLOW)),
    "noisy": _pushes_with(_set(_NOISY)),
    "noisy_slow": _pushes_with(_set(_NOISY, _SLOW)),
    "rubbing": _pushes_with(_set(_RUBBING)),
    "rubbing_known": _pushes_with(_set(_RUBBING, "robot.joint_friction_nm=0.1")),
    "rubbing_estimated": _pushes_with(f"--warm-up 3 {_set(_RUBBING, 'joint_friction={}')}"),
    "locomotion": Group("bench_locomotion.py --quick", "bench_locomotion.py --quick --skip-pushes", of_locomotion),
    "loop": Group("bench_loop.py", "bench_loop.py --repeats 1 --skip-start", of_loop),
    "wbc": Group("bench_wbc.py", "bench_wbc.py --robots solo12 --facets 12", of_wbc),
    "mpc_full_body": _updates("full_body"),
    "estimation": Group("bench_estimation.py", "bench_estimation.py", of_estimation),
    "actions": Group("bench_actions.py", "bench_actions.py --repeat 100", of_actions),
    "optimiser": Group("bench_optimiser.py", "bench_optimiser.py --nodes 20 --rounds 3", of_optimiser),
    "compilation": Group("bench_compilation.py", "bench_compilation.py --robots solo12 --configs", of_compilation),
}


def measure(group: Group, *, quick: bool = False) -> dict[str, Any]:
    """Run a group's command and return its record, with the figures that the pages show."""
    script, *arguments = (group.quick if quick else group.command).split()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "record.json"
        subprocess.run([sys.executable, ROOT / "scripts" / script, *arguments, "--json", file], check=True)
        record: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return record | {"figures": rounded(group.shown(record["figures"]))}


def rounded(value: Any) -> Any:
    """Return figures with four significant digits: more are noise."""
    if isinstance(value, dict):
        return {name: rounded(each) for name, each in value.items()}
    return float(f"{value:.4g}") if isinstance(value, float) else value


def look_up(path: str, records: Mapping[str, Any]) -> Any:
    """Return the value of ``group.figure...``; ``None`` if it has not been measured."""
    group, *names = path.split(".")
    value = records.get(group, {}).get("figures")
    for name in names:
        value = value.get(name) if isinstance(value, dict) else None
    return value


def filled(template: str, records: Mapping[str, Any]) -> str:
    """Return lines with figures in their places, three significant digits unless a format is given.

    A line without all of its figures is left out.
    """
    lines = []
    for line in template.splitlines():
        places = [look_up(path, records) for path, _ in PLACE.findall(line)]
        if None not in places:
            values = iter(places)
            lines.append(PLACE.sub(lambda place: _cell(next(values), place[2]), line))  # noqa: B023
    return "\n".join(lines)


def _cell(value: float | str, form: str | None) -> str:
    return value if isinstance(value, str) else format(value, form or ".3g")


def origins(records: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of the table of commands, dates and machines."""
    yield "| figures | command | date | machine | versions |"
    yield "|---|---|---|---|---|"
    for name in GROUPS:
        record = records.get(name)
        if record is None:
            yield f"| {name} | `python scripts/{GROUPS[name].command}` | not measured yet | | |"
            continue
        host, packages = record["host"], record["versions"]
        machine = f"{host['cpu']}, {host['cores']} cores, {host['system']}" + (
            f"; {record['note']}" if "note" in record else ""
        )
        chosen = [
            f"{each} {packages[each]}"
            for each in ("python", "pin", "casadi", "mujoco", "crocoddyl")
            if each in packages
        ]
        yield f"| {name} | `{record['command']}` | {record['date']} | {machine} | {', '.join(chosen)} |"


def tables(records: Mapping[str, Any]) -> dict[str, str]:
    """Return the tables by name."""
    text = TEMPLATES.read_text(encoding="utf-8")
    found = {
        name: filled(lines.strip("\n"), records)
        for name, lines in re.findall(r"<!-- (\w+) -->\n(.*?)(?=\n<!--|\Z)", text, re.DOTALL)
    }
    return found | {"origins": "\n".join(origins(records))}


def with_tables(page: str, found: Mapping[str, str]) -> str:
    """Return a page's text with its tables replaced."""
    return TABLE.sub(lambda place: f"{place[1]}{found[place[2]]}\n{place[3]}", page)


def main() -> None:
    """Measure, and write JSON and pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=list(GROUPS), default=list(GROUPS), metavar="GROUP")
    parser.add_argument("--quick", action="store_true", help="coarsely; print the tables and write nothing")
    parser.add_argument("--pages", action="store_true", help="measure nothing: write the pages from the JSON")
    options = parser.parse_args()
    records = {} if options.quick else json.loads(FILE.read_text(encoding="utf-8"))
    for name in () if options.pages else options.only:
        print(f"\n== {name}", flush=True)
        records[name] = measure(GROUPS[name], quick=options.quick)
        if not options.quick:
            FILE.write_text(json.dumps(records, indent=1) + "\n", encoding="utf-8")
    found = tables(records)
    if options.quick:
        print("\n\n".join(found.values()))
        return
    for page in PAGES:
        page.write_text(with_tables(page.read_text(encoding="utf-8"), found), encoding="utf-8")


if __name__ == "__main__":
    main()
