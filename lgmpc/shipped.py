"""The configs shipped with lgmpc: inside the installed package, or ``configs/`` at the top of a clone."""

import re
from dataclasses import dataclass
from pathlib import Path

from lgmpc.errors import ConfigError, InputError

_PACKAGE = Path(__file__).resolve().parent
_SCHEMA_LINE = re.compile(r"^# yaml-language-server: \$schema=schema\.json$", re.MULTILINE)


@dataclass(frozen=True)
class ShippedConfig:
    """A shipped config.

    Attributes:
        name: as ``lgmpc run`` and ``load_config`` accept it.
        file: its YAML file.
    """

    name: str
    file: Path

    @property
    def text(self) -> str:
        """The file's content."""
        return self.file.read_text(encoding="utf-8")

    @property
    def command(self) -> str:
        """The command for it: ``sweep`` for a sweep, ``solve`` if it has a section ``problem``, else ``run``."""
        if self.file.parent.name == "sweeps":
            return "sweep"
        return "solve" if re.search(r"^problem:", self.text, re.MULTILINE) else "run"

    @property
    def summary(self) -> str:
        """First sentence of its leading comment."""
        lines = _SCHEMA_LINE.sub("", self.text).lstrip().splitlines()
        paragraph = []
        for line in lines:
            if not line.startswith("# "):
                break
            paragraph.append(line[2:].strip())
        return re.split(r"(?<=\.)\s", " ".join(paragraph), maxsplit=1)[0]

    def copy_text(self) -> str:
        """Return the text for a copy elsewhere, with the schema's absolute path, so that editors find it."""
        schema = self.file.with_name("schema.json")
        return _SCHEMA_LINE.sub(lambda _: f"# yaml-language-server: $schema={schema}", self.text)


def shipped_configs() -> dict[str, ShippedConfig]:
    """Return all shipped configs by name, in alphabetical order."""
    return _found_in(_folder())


def shipped_sweeps() -> dict[str, ShippedConfig]:
    """Return the sweeps over shipped configs by name, in alphabetical order."""
    return _found_in(_folder() / "sweeps")


def _folder() -> Path:
    inside = _PACKAGE / "configs"
    return inside if inside.is_dir() else _PACKAGE.parent / "configs"


def _found_in(folder: Path) -> dict[str, ShippedConfig]:
    return {file.stem: ShippedConfig(file.stem, file) for file in sorted(folder.glob("*.yaml"))}


def shipped_config(name: str) -> ShippedConfig:
    """Return the shipped config or sweep called ``name``.

    Raises:
        ConfigError: if there is none; names the nearest.
    """
    configs = shipped_configs() | shipped_sweeps()
    if name not in configs:
        expected = "the name of one (see `lgmpc configs`)"
        raise ConfigError(name, "", "no shipped config", expected, list(configs), word=name)
    return configs[name]


def config_file(path: str | Path) -> Path:
    """Return the shipped config named ``path`` if there is one and no such file, else ``path`` itself."""
    return _file_of(path, shipped_configs())


def sweep_file(path: str | Path) -> Path:
    """Return the shipped sweep named ``path`` if there is one and no such file, else ``path`` itself."""
    return _file_of(path, shipped_sweeps())


def _file_of(path: str | Path, among: dict[str, ShippedConfig]) -> Path:
    if not isinstance(path, str | Path):
        raise InputError("path", type(path).__name__, "a YAML file, or the name of a shipped one")
    return among[str(path)].file if str(path) in among and not Path(path).is_file() else Path(path)
