"""Lines and files of the package by room, and its longest modules; tests hold the sums (tests/test_architecture.py)."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "lgmpc"
LONGEST = 5


def main() -> None:
    """Print the table."""
    lengths = {path.relative_to(PACKAGE): len(path.read_text("utf-8").splitlines()) for path in PACKAGE.rglob("*.py")}
    lines: Counter[str] = Counter()
    files: Counter[str] = Counter()
    for path, length in lengths.items():
        room = path.parts[0] if len(path.parts) > 1 else "lgmpc"
        lines[room] += length
        files[room] += 1
    for room, length in lines.most_common():
        print(f"{room:12s}{length:7d} lines{files[room]:5d} files")
    print(f"{'together':12s}{sum(lines.values()):7d} lines{len(lengths):5d} files")
    for path in sorted(lengths, key=lengths.__getitem__)[-LONGEST:]:
        print(f"  {path}: {lengths[path]}")


if __name__ == "__main__":
    main()
