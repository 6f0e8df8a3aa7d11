"""Films of replays, decoded again."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from lgmpc.chromium import find_chromium
from lgmpc.errors import InputError, MissingDependencyError, RunFolderError
from lgmpc.robot import Robot
from lgmpc.runs import Run
from lgmpc.viz import film, replay_page
from lgmpc.viz.film import find_ffmpeg, write_film

browser = [
    pytest.mark.browser,
    pytest.mark.skipif(find_chromium() is None, reason="no Chromium is installed: apt-get install chromium"),
]
SIZE = (320, 180)


def decoded(file: Path, size: tuple[int, int]) -> np.ndarray:
    command = [find_ffmpeg(), "-loglevel", "error", "-i", file, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(command, capture_output=True, check=True)
    return np.frombuffer(done.stdout, np.uint8).reshape(-1, size[1], size[0], 3).astype(int)


@pytest.fixture(scope="module")
def page(solo12: Robot, pushed_run: Run) -> str:
    return replay_page(solo12, pushed_run)


@pytest.mark.parametrize(
    ("suffix", "size"),
    [pytest.param(".mp4", SIZE, marks=browser), pytest.param(".gif", (160, 90), marks=[*browser, pytest.mark.slow])],
)
def test_a_film_has_a_picture_for_each_time_and_the_robot_moves(
    suffix: str, size: tuple[int, int], page: str, tmp_path: Path
) -> None:
    file = tmp_path / f"film{suffix}"
    write_film(page, file, 0.6, rate_hz=5.0, size=SIZE)
    pictures = decoded(file, size)
    assert len(pictures) == 4
    robot = pictures[:, size[1] // 3 :]  # without the caption
    assert all(np.abs(robot[-1] - each).max() > 40 for each in robot[:-1])
    assert robot[0].std() > 10.0
    assert [each.name for each in tmp_path.iterdir()] == [file.name]


def test_another_suffix_a_missing_folder_and_missing_programs_are_named(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match=r"film.avi; expected a file that ends in .mp4 or .gif"):
        write_film(page, tmp_path / "film.avi", 0.1)
    with pytest.raises(RunFolderError, match="no such file or directory"):
        write_film(page, tmp_path / "none" / "film.mp4", 0.1)
    monkeypatch.delenv("CHROMIUM", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    find_spec = film.importlib.util.find_spec
    with monkeypatch.context() as patch:
        patch.setattr(film, "find_ffmpeg", lambda: "ffmpeg")
        with pytest.raises(MissingDependencyError, match="apt-get install chromium"):
            write_film(page, tmp_path / "film.mp4", 0.1)
    monkeypatch.setattr(film.importlib.util, "find_spec", lambda name: None if "ffmpeg" in name else find_spec(name))
    with pytest.raises(MissingDependencyError, match=r'apt-get install ffmpeg, or pip install "lgmpc\[video\]"'):
        write_film(page, tmp_path / "film.mp4", 0.1)
    assert not list(tmp_path.iterdir())
