"""The pages of the site and the README: their commands parse, their YAML is valid, their Python is executed."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
import shlex
import sys
from pathlib import Path

import pytest
import typer
import yaml
from public_names import public_names

import lgmpc
import lgmpc.demos as catalogue
from lgmpc.cli.app import app
from lgmpc.config import Config, load_any_config, parse_any_config
from lgmpc.config.build import prepare
from lgmpc.config.solving import prepare_solve
from lgmpc.shipped import shipped_configs, shipped_sweeps
from lgmpc.sweeps import load_sweep, parse_sweep

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
PAGES = [page for page in PAGES if "_build" not in page.parts]
FRAGMENTS_OF = "solo12_velocity"  # the config that a page's single sections are sections of


def fences(page: Path, language: str) -> list[str]:
    """Return the contents of a page's code blocks in a language."""
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def commands() -> list[tuple[str, str]]:
    """Return page and command of every call of lgmpc."""
    lines = [(page, line) for page in PAGES for block in fences(page, "bash") for line in block.splitlines()]
    parts = [(page.name, part.strip()) for page, line in lines for part in re.split(r" && | \| ", line)]
    return [(page, part) for page, part in parts if re.match(r"(\S*/)?lgmpc ", part)]


def yaml_blocks() -> list[tuple[str, str]]:
    """Return page and text of every YAML block."""
    return [(page.name, block) for page in PAGES for block in fences(page, "yaml")]


@pytest.mark.parametrize(("page", "line"), commands())
def test_a_command_parses_and_what_it_names_exists(page: str, line: str) -> None:
    _, name, *words = shlex.split(line, comments=True)
    group = typer.main.get_command(app)
    with group.make_context("lgmpc", [], resilient_parsing=True) as outer:
        command = group.get_command(outer, name)  # type: ignore[attr-defined]
        assert command is not None, f"{page}: no command {name}"
        with command.make_context(name, [], parent=outer, resilient_parsing=True) as inner:
            _, rest, _ = command.make_parser(inner).parse_args(list(words))
    assert not rest
    target = words[0] if words and not words[0].startswith("-") else ""
    overrides = [word for word in words if re.fullmatch(r"[a-z][\w.]*=.*", word)]
    if target in shipped_configs() or target.startswith("configs/"):
        load_any_config(ROOT / target if "/" in target else target, overrides)
    elif target in shipped_sweeps() and name == "sweep":
        load_sweep(target, overrides)
    elif name == "demo" and target:
        assert target in (*catalogue.NAMES, "NAME")
    else:  # a file or a folder of the reader's, or none
        assert not re.fullmatch(r"[a-z0-9]+_[a-z0-9_]+", target), f"{page}: '{target}' is not shipped"


@pytest.mark.parametrize(("page", "text"), yaml_blocks())
def test_a_yaml_block_is_a_config_a_sweep_or_sections_of_a_config(page: str, text: str) -> None:
    content = yaml.safe_load(text)
    if "cff-version" in content:
        return
    if "base" in content:
        assert parse_sweep(text, name=page).points
    elif "robot" in content:
        parse_any_config(text, name=page)
    else:
        whole = yaml.safe_load(shipped_configs()[FRAGMENTS_OF].text)
        parse_any_config(yaml.safe_dump({**whole, **content}), name=page)


@pytest.mark.slow
@pytest.mark.parametrize(("page", "text"), [(page, text) for page, text in yaml_blocks() if "\nrobot:" in text])
def test_a_complete_config_on_a_page_passes_its_gate(
    page: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = "\n".join(each.read_text(encoding="utf-8") for each in PAGES if each.name == page)
    for module, code in re.findall(r"^(\w+) = '''\n(.*?)'''", source, re.MULTILINE | re.DOTALL):
        (tmp_path / f"{module}.py").write_text(code, encoding="utf-8")  # of tasks and costs of one's own
    monkeypatch.chdir(tmp_path)
    config = parse_any_config(text, name=page)
    session = prepare(config) if isinstance(config, Config) else prepare_solve(config)
    verdict = session.run(lambda progress: None).verdict
    assert verdict.passed, verdict.reasons


@pytest.mark.parametrize("page", [page for page in PAGES if page.is_relative_to(DOCS)], ids=lambda page: page.stem)
def test_python_on_the_pages_is_executed(page: Path) -> None:
    assert not fences(page, "python"), "write a code cell, which the build executes"
    if "{code-cell}" in page.read_text(encoding="utf-8"):
        assert page.read_text(encoding="utf-8").startswith("---\nfile_format: mystnb\n")


def test_code_that_pages_include_is_there() -> None:
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for file, names in re.findall(
            r"^```\{literalinclude\} (\S+)\n(?::language: python\n:pyobject: (\S+))?", text, re.M
        ):
            source = (page.parent / file).read_text(encoding="utf-8")
            for name in filter(None, names.split(".")):
                assert re.search(rf"^ *(class|def) {name}\b", source, re.MULTILINE), f"{page.name}: {name} of {file}"


def test_the_page_of_benchmarks_has_every_script() -> None:
    text = (DOCS / "project" / "benchmarks.md").read_text(encoding="utf-8")
    assert {file.name for file in (ROOT / "scripts").glob("bench_*.py")} == set(re.findall(r"bench_\w+\.py", text))


@pytest.mark.slow
def test_python_in_the_readme_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("lgmpc.config.showing.open_page", lambda file: None)
    blocks = fences(ROOT / "README.md", "python")
    assert blocks
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "README.md", "exec"), names)


def test_the_readme_is_short_and_its_links_lead_somewhere() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.encode()) < 8000
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        assert (ROOT / target).is_file(), target


def test_the_paper_cites_what_its_bibliography_has() -> None:
    text = (ROOT / "paper.md").read_text(encoding="utf-8").split("---", 2)[2]
    entries = re.findall(r"^@\w+\{(\w+),$", (ROOT / "paper.bib").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(set(re.findall(r"@(\w+)", text))) == sorted(entries)


def documented_packages() -> set[str]:
    """Return the packages of the reference, read from the source: importing it requires Sphinx."""
    source = ast.parse((DOCS / "reference_pages.py").read_text(encoding="utf-8"))
    (groups,) = (node.value for node in source.body if isinstance(node, ast.AnnAssign) and node.target.id == "GROUPS")  # type: ignore[union-attr]
    return {package for packages in ast.literal_eval(groups).values() for package in packages}


def test_all_names_of_lgmpc_are_from_packages_of_the_reference() -> None:
    assert set(lgmpc._MODULE_OF.values()) <= documented_packages()


def test_links_to_names_lead_to_public_ones() -> None:
    packages = documented_packages()
    for page in PAGES:
        for kind, target in re.findall(r"\{(obj|mod)\}`(?:[^`<]*<)?(lgmpc[\w.]*)>?`", page.read_text(encoding="utf-8")):
            package, _, name = target.rpartition(".")
            fine = target in packages if kind == "mod" else package == "lgmpc" or package in packages
            assert fine, f"{page.name}: {target}"
            assert kind == "mod" or name in public_names(package), f"{page.name}: {target}"


@pytest.mark.docs
def test_every_room_with_public_names_is_in_the_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(str(DOCS))
    pages = importlib.import_module("reference_pages")
    sys.modules.pop("reference_pages")
    packages = {f"lgmpc.{info.name}" for info in pkgutil.iter_modules(lgmpc.__path__) if info.ispkg}
    packages = {name for name in packages if public_names(name)}
    assert packages - set(pages.PACKAGES) == {"lgmpc.cli"}
    for package in pages.PACKAGES:
        text = pages.package_page(package, "")
        for name in public_names(package):
            assert f"`{name} <" in text


def test_tutorials_are_numbered() -> None:
    """In their files' names, their titles and the list of them, in the same order."""
    pages = sorted(path for path in (DOCS / "tutorials").glob("*.md") if path.stem != "index")
    listed = (DOCS / "tutorials" / "index.md").read_text()
    assert re.findall(r"^\d_\w+$", listed, re.MULTILINE) == [page.stem for page in pages]
    for number, page in enumerate(pages, 1):
        title = re.search(rf"^# ({number}\. .+)$", page.read_text(), re.MULTILINE)
        assert title is not None and f"| [{title[1]}]({page.name}) |" in listed
