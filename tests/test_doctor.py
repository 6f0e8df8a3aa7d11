"""The doctor's checks pass here; faults made on purpose are found, with a remedy."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from lgmpc.doctor import Check, iterate_checks


@pytest.fixture(autouse=True)
def surroundings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("CC", "LGMPC_CFLAGS", "LGMPC_JIT"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("LGMPC_CACHE_DIR", str(tmp_path / "cache"))


def check_of(name: str) -> Check:
    """The one check with this name, without doing those after it."""
    return next(check for check in iterate_checks() if check.name == name)


def test_all_checks_pass_here(tmp_path: Path) -> None:
    checks = list(iterate_checks())
    assert [check for check in checks if not check.ok and check.name not in ("compiler", "compiled code")] == []
    names = [check.name for check in checks]
    assert len(set(names)) == len(names)
    declared = {Requirement(line).name for line in metadata.requires("lgmpc") or () if "extra ==" not in line}
    assert declared < set(names)
    asked = {"python", "compiler", "compiled code", "cache", "robot", "mujoco plant", "chromium", "threads"}
    solvers = {"QP by osqp", "QP by piqp", "QP by proxsuite", "NLP by ipopt", "NLP by fatrop"}
    assert asked | solvers == set(names) - declared
    assert "solo12: 12 actuated joints" in next(c.detail for c in checks if c.name == "robot")
    assert list((tmp_path / "cache").iterdir()) == [], "the self-test leaves nothing in the cache"


def test_broken_compiler_is_found_by_the_self_test(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = tmp_path / "broken-cc"
    broken.write_text('#!/bin/sh\n[ "$1" = --version ] && echo broken 1.0 && exit 0\necho no space left >&2\nexit 1\n')
    broken.chmod(0o755)
    monkeypatch.setenv("CC", str(broken))
    assert check_of("compiler").ok
    check = check_of("compiled code")
    assert not check.ok and "no space left" in check.detail and check.remedy


def test_unusable_settings_are_findings_not_crashes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    check = check_of("compiler")
    assert not check.ok and "CC: got 'no-such-compiler'" in check.detail and "unset CC" in check.remedy


def test_cache_that_others_may_write_to_is_found(tmp_path: Path) -> None:
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache").chmod(0o777)
    check = check_of("cache")
    assert not check.ok and "others may write" in check.detail and "chmod 700" in check.remedy


def test_damaged_library_is_counted(tmp_path: Path) -> None:
    (tmp_path / "cache").mkdir(mode=0o700)
    (tmp_path / "cache" / "f-key-0123456789abcdef.so").write_bytes(b"torn")
    check = check_of("cache")
    assert check.ok and "1 compiled" in check.detail and "1 damaged" in check.detail


def test_requested_interpretation_is_reported_and_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LGMPC_JIT", "0")
    assert check_of("compiler").ok and "LGMPC_JIT=0" in check_of("compiler").detail
    assert check_of("compiled code").detail == "not tried: no compiler is used"


@pytest.mark.parametrize(("setting", "advice"), [("1", False), ("4", True), (None, True)])
def test_threads_are_advice_only(setting: str | None, advice: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if setting is not None:
        monkeypatch.setenv("OMP_NUM_THREADS", setting)
    check = check_of("threads")
    assert check.ok and bool(check.remedy) == advice


def test_packages_that_do_not_import_fail_their_own_checks_only(tmp_path: Path) -> None:
    script = """
import sys
sys.modules["osqp"] = sys.modules["mujoco"] = sys.modules["casadi"] = None
from lgmpc.doctor import iterate_checks
print(*(check.name for check in iterate_checks() if not check.ok), sep=",")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=dict(os.environ))
    assert done.returncode == 0, done.stderr
    failed = set(done.stdout.strip().split(","))
    assert {"QP by osqp", "NLP by ipopt", "mujoco plant"} <= failed
    assert failed.isdisjoint({"python", "QP by piqp", "QP by proxsuite", "chromium", "threads", "osqp"})


def test_version_outside_the_tested_range_is_found() -> None:
    from lgmpc.doctor import _check_version

    wanted = Requirement("numpy>=1.0,<1.1")
    check = _check_version(wanted.name, wanted.specifier, f'pip install "{wanted}"')
    assert not check.ok and "tested with >=1.0,<1.1" in check.detail and "pip install" in check.remedy
    absent = Requirement("no-such-package-anywhere>=2")
    missing = _check_version(absent.name, absent.specifier, f'pip install "{absent}"')
    assert not missing.ok and missing.detail == "not installed (tested with >=2)"
