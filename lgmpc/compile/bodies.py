"""CasADi's C of scalar operations, for a compiler: long bodies in parts, without branches.

CasADi writes a function of scalar operations as one body, with a branch at each entry that it reads or writes
(arguments and results may be missing) and at each condition. The time that a compiler takes grows faster than such a
body. So it is cut into functions that pass values through memory, missing arguments are zeros, missing results are
written to memory that nothing reads, and conditions are masks. The operations and their order stay, and so do all bits
of the results.
"""

from __future__ import annotations

import re
from typing import NamedTuple

__all__ = ["BODIES_IDENTITY", "STATEMENTS", "write_in_parts"]

STATEMENTS = 500
"""Most statements of a function: 200 take longer to run, 1000 to compile."""

_DECLARATIONS = """\
#ifdef __GNUC__
  #define LGMPC_PART static __attribute__((noinline))
#else
  #define LGMPC_PART static
#endif
static inline casadi_real lgmpc_where(casadi_real condition, casadi_real value) {
  union { casadi_real number; long long int bits; } masked;
  masked.number = value;
  masked.bits &= -(long long int) (condition != 0);
  return masked.number;
}

"""
_PART = """\
LGMPC_PART void {name}_part{i}(const casadi_real* const* x, casadi_real* const* r, casadi_real* restrict m) {{
  casadi_real {variables};
  (void) x; (void) r; (void) m;
{body}
}}

"""
_WHOLE = """\
{head}
  static const casadi_real zeros[{n_zeros}];
  casadi_real ignored[{n_ignored}], m[{n_memory}], *r[{n_r}];
  const casadi_real* x[{n_x}];
  (void) zeros; (void) ignored;
{body}
  return 0;
}}
"""
_FUNCTION = re.compile(r"^(static int (casadi_f\d+)\([^)]*\) \{)\n(.*?)^\}\n", re.MULTILINE | re.DOTALL)
_DECLARATION = re.compile(r"  casadi_real a\d+(, a\d+)*;")
_STATEMENT = re.compile(r"  (?:(a\d+)|r\[\d+\]\[\d+\])=(.*;)")
_READ, _WRITE = re.compile(r"=arg\[(\d+)\]\? arg\[\1\](\[\d+\]) : 0;"), re.compile(r"if \(res\[(\d+)\]!=0\) res\[\1\]")
_CONDITION = re.compile(r"\((a\d+)\?(a\d+):0\)")
_VARIABLE, _ENTRY = re.compile(r"\ba\d+\b"), re.compile(r"\b([xr])\[(\d+)\]\[(\d+)\]")

BODIES_IDENTITY = ("1", str(STATEMENTS), _DECLARATIONS, _PART, _WHOLE)


class _Statement(NamedTuple):
    """A line of C; ``target`` is empty where it writes a result."""

    text: str
    target: str
    reads: list[str]


def write_in_parts(code: str) -> str:
    """Return CasADi's C code with all its functions of scalar operations in parts; others stay as they are."""
    first = _FUNCTION.search(code)
    if first is None:
        return code
    return code[: first.start()] + _DECLARATIONS + _FUNCTION.sub(_rewrite, code[first.start() :])


def _rewrite(function: re.Match[str]) -> str:
    head, name, body = function.groups()
    plain = _CONDITION.sub(r"lgmpc_where(\1, \2)", _WRITE.sub(r"r[\1]", _READ.sub(r"=x[\1]\2;", body)))
    *lines, last = [line for line in plain.splitlines() if not _DECLARATION.fullmatch(line)]
    found = [_STATEMENT.fullmatch(line) for line in lines]
    if not found or last != "  return 0;":
        return function[0]
    statements = []
    for match in found:
        if match is None:
            return function[0]
        statements.append(_Statement(match[0], match[1] or "", _VARIABLE.findall(match[2])))
    parts, n_memory = _cut(name, statements)
    sizes: dict[str, dict[int, int]] = {"x": {}, "r": {}}
    for kind, column, entry in _ENTRY.findall(plain):
        sizes[kind][int(column)] = max(sizes[kind].get(int(column), 1), int(entry) + 1)
    calls = [
        *(f"  x[{i}] = arg[{i}] ? arg[{i}] : zeros;" for i in sizes["x"]),
        *(f"  r[{i}] = res[{i}] ? res[{i}] : ignored;" for i in sizes["r"]),
        *(f"  {name}_part{i}(x, r, m);" for i in range(len(parts))),
    ]
    n_zeros, n_ignored = (max(sizes[kind].values(), default=1) for kind in "xr")
    n_x, n_r = (max(sizes[kind], default=0) + 1 for kind in "xr")
    return "".join(parts) + _WHOLE.format(
        head=head, n_zeros=n_zeros, n_ignored=n_ignored, n_memory=max(n_memory, 1), n_x=n_x, n_r=n_r,
        body="\n".join(calls),
    )  # fmt: skip


def _cut(name: str, statements: list[_Statement]) -> tuple[list[str], int]:
    """Return C functions of the statements, and how many values pass from one to another.

    A value is loaded where it is first read and stored where it is written: loaded at the beginning of a part, it would
    be moved from memory to the stack.
    """
    parts = [statements[i : i + STATEMENTS] for i in range(0, len(statements), STATEMENTS)]
    places: dict[str, int] = {}
    functions = []
    for i, (part, later) in enumerate(zip(parts, _read_later(parts), strict=True)):
        final = {statement.target: k for k, statement in enumerate(part)}
        known: dict[str, None] = {}  # in order
        lines = []
        for k, (text, target, reads) in enumerate(part):
            lines += [f"  {read} = m[{places[read]}];" for read in dict.fromkeys(reads) if read not in known]
            known.update(dict.fromkeys(reads))
            lines.append(text)
            if target:
                known[target] = None
            if target in later and final[target] == k:
                lines.append(f"  m[{places.setdefault(target, len(places))}] = {target};")
        functions.append(_PART.format(name=name, i=i, variables=", ".join(known), body="\n".join(lines)))
    return functions, len(places)


def _read_later(parts: list[list[_Statement]]) -> list[set[str]]:
    """Return for each part the variables whose values after it are read by those that follow."""
    needed: set[str] = set()
    later = []
    for part in reversed(parts):
        later.append(needed)
        needed = set(needed)
        for _, target, reads in reversed(part):
            needed.discard(target)
            needed.update(reads)
    return later[::-1]
