"""``lgmpc run --from``: repeated, continued, refused."""

import json
from pathlib import Path

import pytest

from .conftest import Invoke

SHORT = ("duration_s=0.1", "mpc.enabled=false", "gate={max_tilt_deg: 5}")


@pytest.fixture
def runs(tmp_path: Path, invoke: Invoke) -> Path:
    assert invoke("run", "solo12_stand", *SHORT, "--quiet", "--out", tmp_path / "runs")[0] == 0
    return tmp_path / "runs"


def test_a_run_is_repeated_and_continued(runs: Path, invoke: Invoke) -> None:
    code, output = invoke("run", "--from", "latest", "--out", runs)
    assert code == 0 and "50 logged ticks repeated bit for bit\n" in output
    code, output = invoke("run", "wbc.gains.com.kp=50", "plant.friction=0.5", "--from", "latest@0.06", "--out", runs)
    assert code == 0 and "30 logged ticks repeated bit for bit; changed at 0.060 s: " in output
    assert "plant.friction 0.6 -> 0.5" in output and "wbc.gains.com.kp" in output
    code, output = invoke("run", "--from", "latest@0.08", "--set", "duration_s=0.12", "--json", "--out", runs)
    origin = json.loads(output[output.index("{") :])["from"]
    assert code == 0 and origin["verified_ticks"] == 40 and origin["changes"] == {"duration_s": [0.1, 0.12]}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "CONFIG: got nothing; expected a config to simulate, or --from RUN@TIME"),
        (("solo12_stand", "--from", "latest@0.05"), "CONFIG: got solo12_stand; expected none with --from"),
        (("--from", "latest@soon"), "--from: got latest@soon; expected RUN, or RUN@TIME with a time in s"),
        (("--from", "latest@0.2"), "time_s: got 0.2; expected a time in the log"),
        (("--from", "lates@0.05"), "no run folder lates"),
        (("--from", "latest@0.05", "wbc.gain.com.kp=50"), "wbc.gains"),
        (("--from", "latest@0.05", "--plant", "pinocchio"), "plant.kind: got pinocchio"),
    ],
)
def test_what_cannot_be_repeated_is_bad_input(
    runs: Path, invoke: Invoke, arguments: tuple[str, ...], message: str
) -> None:
    code, output = invoke("run", *arguments, "--out", runs, "--quiet")
    assert code == 2 and message in output
    assert len(list(runs.iterdir())) == 1
