"""The check of the built site finds what is wrong, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest
from check_site import Page, fault_of, faults

GOOD = """<html><body><h1 id="top">A</h1><a href="#top">up</a> <a href="folder/other.html#here">other</a>
<a href="https://example.org/a?b=c#d">out</a> <a href="mailto:a@example.org">mail</a> <a href="data.csv">data</a>
<img src="data:image/png;base64,AAAA" alt="a figure"></body></html>"""


@pytest.fixture
def site(tmp_path: Path) -> Path:
    (tmp_path / "folder").mkdir()
    (tmp_path / "index.html").write_text(GOOD)
    (tmp_path / "data.csv").write_text("1,2")
    (tmp_path / "folder" / "other.html").write_text('<p id="here">B</p><a href="../index.html">back</a>')
    return tmp_path


def test_a_site_without_faults_has_none(site: Path) -> None:
    assert list(faults(site)) == []
    assert len(Page.read(site / "index.html").links) == 5


@pytest.mark.parametrize(
    ("wrong", "fault"),
    [
        ('<a href="folder/none.html">', "no such page"),
        ('<a href="folder/other.html#there">', "no such place on the page"),
        ('<a href="#down">', "no such place on the page"),
        ('<a href="none.csv">', "no such file"),
        ('<a href="https://example">', "not an address"),
        ('<a href="https://example.org/a b">', "not an address"),
        ('<a href="ftp://example.org">', "not an address"),
        ('<img src="data:image/png;base64,AAAA" alt=" ">', "a picture without a text (alt)"),
        ('<img src="data:image/png;base64,AAAA" alt="_images/3f0.png">', "a picture without a text (alt)"),
        ('<img src="none.png" alt="a">', "no such picture"),
    ],
)
def test_a_fault_is_found(wrong: str, fault: str, site: Path) -> None:
    (site / "index.html").write_text(GOOD.replace("</body>", f"{wrong}</body>"))
    (found,) = faults(site)
    assert found.startswith("index.html: ") and found.endswith(fault)


def test_a_quoted_fragment_is_the_id_that_it_quotes(site: Path) -> None:
    file = (site / "folder" / "other.html").resolve()
    file.write_text('<p id="größe">')
    assert fault_of("#gr%C3%B6%C3%9Fe", file, {file: Page.read(file)}) == ""
