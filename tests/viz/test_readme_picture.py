from __future__ import annotations

import runpy
import sys
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from lgmpc.chromium import find_chromium
from lgmpc.config import dump_config, load_config
from lgmpc.runs import RunFolder

ROOT = Path(__file__).parents[2]


def run_script(monkeypatch, *arguments) -> int:
    monkeypatch.setattr(sys, "argv", ["make_readme_picture.py", *map(str, arguments)])
    main = runpy.run_path(str(ROOT / "scripts" / "make_readme_picture.py"))["main"]
    return main()


@pytest.fixture
def folder(pushed_run, tmp_path) -> RunFolder:
    """The pushed run beside a config of the same robot."""
    folder = RunFolder.create(tmp_path, "solo12_pushed")
    folder.write_config(dump_config(load_config(ROOT / "configs" / "solo12_balance.yaml")))
    folder.write_arrays(pushed_run.log)
    folder.write_result(pushed_run.result)
    return folder


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.skipif(find_chromium() is None, reason="no Chromium is installed: apt-get install chromium")
def test_the_picture_shows_the_push_and_the_calm_after_it(folder, tmp_path, monkeypatch, capsys) -> None:
    picture = tmp_path / "assets" / "picture.png"
    assert run_script(monkeypatch, folder.path, picture) == 0
    assert str(picture) in capsys.readouterr().out
    image = np.round(255.0 * imread(BytesIO(picture.read_bytes()))[:, :, :3]).astype(int)
    height, width = image.shape[:2]
    assert width > 2 * height
    red, green, blue = np.moveaxis(image, 2, 0)
    arrow = (red > 130) & (green < 0.55 * red) & (blue < 0.3 * red)
    dark = (image.max(axis=2) < 150) & (np.ptp(image, axis=2) < 45)
    pushed, furthest, calm = (slice(k * width // 3, (k + 1) * width // 3) for k in range(3))
    assert arrow[:, pushed].sum() > 200 and arrow[:, calm].sum() == 0
    assert all(dark[:, panel].mean() > 0.05 for panel in (pushed, furthest, calm))


def test_a_run_without_pushes_has_no_picture(folder, pushed_run, tmp_path, monkeypatch, capsys) -> None:
    folder.write_arrays(replace(pushed_run.log, push=np.zeros_like(pushed_run.log.push)))
    assert run_script(monkeypatch, folder.path, tmp_path / "picture.png") == 2
    assert "was not pushed in this run" in capsys.readouterr().err
    assert run_script(monkeypatch, tmp_path / "nothing", tmp_path / "picture.png") == 2
    assert "does not exist" in capsys.readouterr().err
    assert not (tmp_path / "picture.png").exists()
