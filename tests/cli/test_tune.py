"""``lgmpc tune``: search, journal, best config, resumption, errors."""

import json
import signal
from pathlib import Path

import pytest

from lgmpc.config import load_config
from lgmpc.config.yaml_text import parse_yaml
from lgmpc.errors import Interrupted

from .conftest import Invoke

pytest.importorskip("optuna")

pytestmark = pytest.mark.usefixtures("one_worker")

SHORT = ("--set", "duration_s=0.3", "--set", "mpc.enabled=false", "--set", "gate={}", "--seeds", "1", "--workers", "1")
TUNE = ("tune", "solo12_stand", "--keys", "wbc.gains.com.kp=1:200:log", "--objective", "com_rms_error_m", *SHORT)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_stiffer_gain_is_found_saved_and_the_search_goes_on(invoke: Invoke) -> None:
    """A robot that stands sinks by less the stiffer the gain is; here it begins with a soft one."""
    soft = ("--set", "wbc.gains.com.kp=2.0", "--set", "plant.base_added_mass_kg=0.3")
    code, output = invoke(*TUNE, *soft, "--trials", "4")
    assert code == 0, output
    assert "4 of 4 trials" in output and "GAINED  on held-out points" in output and "left" in output
    assert "nothing is random" in output  # a state that is not estimated has no noise
    file = Path("tuning/solo12_stand/best.yaml")
    text = file.read_text(encoding="utf-8")
    assert "# wbc.gains.com.kp: 2.0 became" in text and "held-out points" in text and "numpy" in text
    best = load_config(file)
    assert best.wbc.gains.com.kp > 2.0 and best.plant.base_added_mass_kg == 0.3 and best.duration_s == 0.3
    code, output = invoke(*TUNE, *soft, "--trials", "5", "--resume", "--json")
    content = json.loads(output[output.index("{\n") :])
    assert (code, content["trials"], content["gained"]) == (0, 5, True)
    assert content["best"]["value"] < content["initial"]["value"]
    assert parse_yaml(file.read_text(encoding="utf-8"), "best")[0]["wbc"]["gains"]["com"]["kp"] == pytest.approx(
        content["values"]["wbc.gains.com.kp"]
    )
    code, output = invoke(*TUNE, *soft, "--trials", "5")
    assert (code, "add --resume" in output) == (2, True)
    code, output = invoke(*TUNE, "--resume")
    assert (code, "holds another tuning" in output) == (2, True)


def test_values_that_the_config_refuses_are_trials_without_a_score(invoke: Invoke) -> None:
    rates = ("tune", "solo12_stand", "--keys", "mpc.rate_hz=100:125", "--objective", "com_rms_error_m", *SHORT)
    code, output = invoke(*rates, "--set", "mpc.enabled=true", "--trials", "3")
    assert (code, "3 of 3 trials" in output, "NO GAIN" in output) == (1, True, True)


@pytest.mark.parametrize(("number", "expected"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_signal_before_the_first_trial_has_its_exit_code(
    invoke: Invoke, monkeypatch: pytest.MonkeyPatch, number: signal.Signals, expected: int
) -> None:
    def interrupted(*_: object) -> object:
        raise Interrupted(number)

    with monkeypatch.context() as patch:
        patch.setattr("lgmpc.sweeps.study._Search.run", interrupted)
        code, output = invoke(*TUNE, "--trials", "2")
    assert code == expected
    assert "INTERRUPTED  after 0 trials: the same command with --resume continues" in output
    code, output = invoke(*TUNE, "--trials", "1", "--resume")
    assert (code, "1 of 1 trials" in output) == (1, True)


def test_bad_input_is_one_error_with_key_and_remedy(invoke: Invoke) -> None:
    code, output = invoke("tune", "solo12_stand", "--keys", "wbc.gain.com.kp")
    assert (code, "wbc.gains" in output) == (2, True)
    assert invoke(*TUNE, "--trials", "0")[0] == 2
    assert not Path("tuning").exists()
