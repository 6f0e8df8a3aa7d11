"""A sweep in jobs of SLURM, with programs in place of its own that run the jobs' scripts on this machine."""

import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from lgmpc.cli.sweeping import chosen_cluster
from lgmpc.errors import ClusterError, ConfigError, ConfigErrors, InputError
from lgmpc.sweeps import Ending, run_sweep
from lgmpc.sweeps.slurm import load_slurm, slurm_client

from .conftest import Parse

pytestmark = pytest.mark.skipif(find_spec("dask_jobqueue") is None, reason="dask-jobqueue is not installed")

JOBS = """
jobs: 1
cores: 2
memory_gb: 4
walltime: "00:30:00"
queue: short
account: robots
directives: ["--constraint=avx2"]
setup: ["export PROLOGUE=read"]
"""

SBATCH = """#!{python}
import re, subprocess, sys
from pathlib import Path
place = Path({place!r})
if sys.argv[1] == "--test-only":
    script = Path(sys.argv[2]).read_text()
    if "-A robots\\n" not in script:
        sys.exit("sbatch: error: Batch job submission failed: Invalid account")
    sys.exit(0)
number = 4000 + len(list(place.glob("*.pid")))
script = place / f"{{number}}.sh"
script.write_text(Path(sys.argv[1]).read_text())
out = re.search("#SBATCH -o (.*)", script.read_text())[1].replace("%J", str(number))
with open(out, "w") as stream:
    job = subprocess.Popen(["bash", str(script)], stdout=stream, stderr=stream, start_new_session=True)
(place / f"{{number}}.pid").write_text(str(job.pid))
print(f"Submitted batch job {{number}}")
"""

SCANCEL = """#!{python}
import os, signal, sys
from pathlib import Path
file = Path({place!r}) / f"{{sys.argv[1]}}.pid"
try:
    os.killpg(int(file.read_text()), signal.SIGTERM)
except ProcessLookupError:
    pass
file.with_suffix(".cancelled").touch()
"""


def test_ctrl_c_stays_the_programs_own() -> None:
    """The import of dask_jobqueue sets a handler; in a process of its own, where nothing has imported it before."""
    program = (
        "import signal\n"
        "from lgmpc.sweeps.slurm import _import_jobqueue\n"
        "before = signal.getsignal(signal.SIGINT)\n"
        "_import_jobqueue()\n"
        "assert signal.getsignal(signal.SIGINT) is before\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.fixture
def scheduler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Put ``sbatch`` and ``scancel`` on the path; return the folder of their jobs."""
    place, programs = tmp_path / "jobs", tmp_path / "bin"
    place.mkdir()
    programs.mkdir()
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        file = programs / name
        file.write_text(text.format(python=sys.executable, place=str(place)), encoding="utf-8")
        file.chmod(0o755)
    monkeypatch.setenv("PATH", str(programs), prepend=":")
    return place


def jobs_file(folder: Path, text: str = JOBS) -> Path:
    file = folder / "jobs.yaml"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.slow
def test_a_sweep_runs_in_a_job(tmp_path: Path, scheduler: Path, parse: Parse) -> None:
    sweep = parse("factors: [{key: seed, kind: values, values: [1, 2, 3]}]")
    out = tmp_path / "out"
    finished = run_sweep(sweep, out, cluster=chosen_cluster(None, jobs_file(tmp_path), None))
    assert [row.ending for row in finished.rows.values()] == [Ending.PASS] * 3
    (script,) = scheduler.glob("*.sh")
    lines = script.read_text().splitlines()
    for line in ("-p short", "-A robots", "-t 00:30:00", "--cpus-per-task=2", "--mem=4G", "--constraint=avx2"):
        assert f"#SBATCH {line}" in lines
    assert "export PROLOGUE=read" in lines
    assert script.with_suffix(".cancelled").exists()
    assert (out / "jobs" / f"lgmpc-{script.stem}.out").is_file()


def test_a_job_that_slurm_refuses_is_one_error(tmp_path: Path, scheduler: Path) -> None:
    settings = load_slurm(jobs_file(tmp_path, JOBS.replace("robots", "nobody")))
    with pytest.raises(ClusterError, match="SLURM rejects the job: sbatch: error: .*Invalid account"):
        slurm_client(settings, tmp_path / "out").__enter__()
    assert list(scheduler.iterdir()) == []


def test_a_machine_without_slurm_is_one_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(InputError, match="slurm: got no program sbatch on this machine"):
        slurm_client(load_slurm(jobs_file(tmp_path)), tmp_path).__enter__()


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        ("cores: 2", "", "cores", "got nothing"),
        ("cores: 2", "cores: 0", "cores", "below 1"),
        ("cores: 2", "core: 2", "core", "Did you mean cores"),
        ("memory_gb: 4", "memory_gb: 4GB", "memory_gb", "a number"),
        ('walltime: "00:30:00"', "walltime: 30", "walltime", "expected"),
        ('walltime: "00:30:00"', "walltime: half an hour", "walltime", "expected"),
        ('["--constraint=avx2"]', '["constraint=avx2"]', "directives.0", "expected"),
        ("queue: short", "queue: ''", "queue", "expected"),
    ],
)
def test_a_key_that_cannot_be_used_is_named(tmp_path: Path, old: str, new: str, key: str, words: str) -> None:
    assert old in JOBS
    with pytest.raises(ConfigError, match="jobs.yaml") as caught:
        load_slurm(jobs_file(tmp_path, JOBS.replace(old, new)))
    found = caught.value.problems if isinstance(caught.value, ConfigErrors) else (caught.value,)
    assert key in [each.key for each in found]
    assert words in str(caught.value)


def test_a_file_that_is_none_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file"):
        load_slurm(tmp_path / "jobs.yaml")
    with pytest.raises(ConfigError, match="a table of keys"):
        load_slurm(jobs_file(tmp_path, "- cores"))
