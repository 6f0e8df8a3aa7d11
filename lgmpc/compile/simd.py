"""C of a stage function that evaluates several stages at once: every scalar is a vector, with one stage in each lane.

The long straight-line bodies of dynamics' derivatives are limited by the machine code that streams from the caches;
lanes share it. Each lane does the operations of CasADi's own C in the same order, with the same sines and angles
(``trigonometry.c``: of all lanes at once), and the C library computes other functions one lane after the other, so
results have the same bits. The preprocessor decides how many lanes there are: as many doubles as the processor's
vectors hold; one where the compiler has no vector extensions.

One body of 100,000 vector statements takes GCC a minute (register allocation). So the statements are cut into functions
that pass values through memory, and these are spread over files, which compile in parallel.
"""

import re
from importlib.resources import files
from typing import NamedTuple

import casadi

from lgmpc.errors import CompileError

STATEMENTS = 500
"""Most statements of a function: 200 take longer to run, 1000 to compile."""
_PARTS = 20  # of one file

_UNARY = (
    "exp", "log", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh",
    "atanh", "expm1", "log1p", "erf", "floor", "ceil", "fabs", "sign",
)  # fmt: skip
_BINARY = ("pow", "fmod", "remainder", "copysign", "fmin", "fmax", "atan2", "hypot")

_FORMULAS = {
    casadi.OP_ASSIGN: "{0}",
    casadi.OP_ADD: "{0} + {1}",
    casadi.OP_SUB: "{0} - {1}",
    casadi.OP_MUL: "{0} * {1}",
    casadi.OP_DIV: "{0} / {1}",
    casadi.OP_NEG: "-{0}",
    casadi.OP_INV: "all(1.0) / {0}",
    casadi.OP_SQ: "{0} * {0}",
    casadi.OP_TWICE: "all(2.0) * {0}",
    casadi.OP_LT: "truth((M) ({0} < {1}))",
    casadi.OP_LE: "truth((M) ({0} <= {1}))",
    casadi.OP_EQ: "truth((M) ({0} == {1}))",
    casadi.OP_NE: "truth((M) ({0} != {1}))",
    casadi.OP_NOT: "truth((M) ({0} == all(0.0)))",
    casadi.OP_AND: "truth((M) ({0} != all(0.0)) & (M) ({1} != all(0.0)))",
    casadi.OP_OR: "truth((M) ({0} != all(0.0)) | (M) ({1} != all(0.0)))",
    casadi.OP_IF_ELSE_ZERO: "select({0}, {1})",
    casadi.OP_CONSTPOW: "each_pow({0}, {1})",
    **{getattr(casadi, f"OP_{name.upper()}"): f"each_{name}({{0}})" for name in _UNARY},
    **{getattr(casadi, f"OP_{name.upper()}"): f"each_{name}({{0}}, {{1}})" for name in _BINARY},
}

_FOLDER = files("lgmpc.compile")

# How many doubles the processor's vectors hold, and the vectors' type; one number where there are none.
_VECTORS = _FOLDER.joinpath("vectors.c").read_text(encoding="utf-8")

# Entry points, and arithmetic that rounds as numpy's does: for lgmpc's own C sources.
EXACT = _FOLDER.joinpath("exact.c").read_text(encoding="utf-8")

# Vectors, and transposition of squares of them: for lgmpc's own C sources.
SQUARES = _VECTORS + _FOLDER.joinpath("squares.c").read_text(encoding="utf-8")

_TRIGONOMETRY = _FOLDER.joinpath("trigonometry.c").read_text(encoding="utf-8")
_SINES = ("sin", "cos", "tan", "atan2")  # what is there

_ARGUMENT = re.compile(r"\b([xr])(\d+)\[")

_COMMUTATIVE = (casadi.OP_ADD, casadi.OP_MUL)

_HEAD = _VECTORS + _FOLDER.joinpath("each.c").read_text(encoding="utf-8")
_HEAD += "".join(
    [
        _TRIGONOMETRY,
        *(f"EACH({name})\n" for name in _UNARY if name not in _SINES),
        *(f"EACH2({name})\n" for name in _BINARY if name not in _SINES),
    ]
)

# Work memory follows the results; those that are always zero are never written, in memory that is zero at first.
_ENTRY = _FOLDER.joinpath("entry.c").read_text(encoding="utf-8")

# One pointer from Python costs half as much as CasADi's five arguments. The loop over stages is here because
# casadi.Function.map copies every output twice and every shared input once per stage.
_LOOP = _FOLDER.joinpath("loop.c").read_text(encoding="utf-8")
"""Entry that evaluates one stage after the other; they may read what those before them wrote."""

_ONE = "#undef LANES\n#define LANES 1\n"

_VERSION = "8"  # part of every cache key: increase it when the functions below change
SIMD_IDENTITY = (_VERSION, _HEAD, _ENTRY, _LOOP, *_FORMULAS.values(), f"{STATEMENTS} {_PARTS}")


class _Statement(NamedTuple):
    """``target = results[0] = ... = formula(reads)``, in C; no variable is assigned twice."""

    target: str
    formula: str
    reads: tuple[str, ...]
    results: list[str]


def is_scalar_code(function: casadi.Function) -> bool:
    """Return whether a function is a list of scalar operations that have a formula."""
    if not function.is_a("SXFunction"):
        return False
    known = {*_FORMULAS, casadi.OP_INPUT, casadi.OP_OUTPUT, casadi.OP_CONST}
    return all(function.instruction_id(k) in known for k in range(function.n_instructions()))


def generate_simd(function: casadi.Function, lanes: bool = True) -> tuple[str, ...]:
    """Return the C files of a dense function.

    The entry that :mod:`lgmpc.compile.pipeline` calls is ``<name>_lanes(arguments, results, work)``, of pointers to
    vectors; ``<name>_lanes_work`` returns how many vectors of work memory it takes.

    Args:
        function: of one stage.
        lanes: False for vectors of one number, and an entry that calls it for one stage after the other.

    Raises:
        CompileError: the function is not a list of scalar operations (see :func:`is_scalar_code`).
    """
    if not is_scalar_code(function):
        raise CompileError(function.name(), "SIMD code", "it is not a list of scalar operations")
    name, head = function.name(), _HEAD if lanes else _ONE + _HEAD
    parts, shared = _write_parts(name, _read(function, zeros=not lanes))
    entry = _ENTRY.format(
        name=name, n_w=shared,
        declarations="".join(f"void {name}_part{i}(const V* const*, V* const*, V*);\n" for i in range(len(parts))),
        calls="".join(f"  {name}_part{i}(x, r, w);\n" for i in range(len(parts))),
    )  # fmt: skip
    if not lanes:
        n_in = function.n_in()
        entry += _LOOP.format(name=name, n_in=n_in, arguments=n_in + function.n_out())
    bodies = ["".join(parts[i : i + _PARTS]) for i in range(0, len(parts), _PARTS)]
    if len(bodies) == 1:  # a second file would take longer to start the compiler on than to compile
        return (head + entry + bodies[0],)
    return tuple(head + body for body in (entry, *bodies))


def _read(function: casadi.Function, zeros: bool) -> list[_Statement]:
    """Return the function's operations, none twice.

    Inputs and constants are written where they are read. Results that are always zero are written if ``zeros``.
    """
    values: dict[int, str] = {}  # what the places of CasADi's work vector hold
    found: dict[str, _Statement] = {}
    known: dict[tuple[int, tuple[str, ...]], str] = {}
    copies: list[_Statement] = []
    for k in range(function.n_instructions()):
        operation, out, into = function.instruction_id(k), function.instruction_output(k), function.instruction_input(k)
        if operation == casadi.OP_OUTPUT:
            value, result = values[into[0]], f"r{out[0]}[{out[1]}]"
            if value in found:
                found[value].results.append(result)
            elif zeros or value != _ZERO:
                copies.append(_Statement(f"v{k}", "{0}", (value,), [result]))
        elif operation == casadi.OP_CONST:
            values[out[0]] = _constant(function.instruction_constant(k))
        elif operation == casadi.OP_INPUT:
            values[out[0]] = f"x{into[0]}[{into[1]}]"
        else:
            reads = tuple(values[i] for i in into)
            same = (operation, tuple(sorted(reads)) if operation in _COMMUTATIVE else reads)
            name = values[out[0]] = known.setdefault(same, f"v{k}")
            found.setdefault(name, _Statement(name, _FORMULAS[operation], reads, []))
    return [*found.values(), *copies]


def _constant(number: float) -> str:
    return f"all({number!r})".replace("inf", "INFINITY").replace("nan", "NAN")


_ZERO = _constant(0.0)


def _write_parts(name: str, statements: list[_Statement]) -> tuple[list[str], int]:
    """Return C functions of the statements, and how many places the values that pass between them take."""
    parts = [statements[i : i + STATEMENTS] for i in range(0, len(statements), STATEMENTS)]
    made = {statement.target: i for i, part in enumerate(parts) for statement in part}
    last = {read: i for i, part in enumerate(parts) for statement in part for read in statement.reads}
    places = {statement.target: statement.results[0] for statement in statements if statement.results}
    free: list[str] = []
    shared = 0
    code = []
    for i, part in enumerate(parts):
        lines, loaded = [], set()
        for target, formula, given, results in part:
            for read in given:
                # Here: loaded at the beginning of the part, it would be moved from memory to the stack.
                if made.get(read, i) < i and read not in loaded:
                    loaded.add(read)
                    lines.append(f"V {read} = {places[read]};")
            lines.append(f"V {target} = {' = '.join([*results, formula.format(*given)])};")
            if last.get(target, i) > i and target not in places:
                if not free:
                    free.append(f"w[{shared}]")
                    shared += 1
                places[target] = free.pop()
                lines.append(f"{places[target]} = {target};")
        free += sorted(places[read] for read in loaded if last[read] == i and places[read][0] == "w")
        body = "\n".join(f"  {line}" for line in lines)
        pointers = sorted(set(_ARGUMENT.findall(body)), key=lambda found: (found[0], int(found[1])))
        places_of = "".join(
            f"  {'const ' if kind == 'x' else ''}V* restrict {kind}{index} = {kind}[{index}];\n"
            for kind, index in pointers
        )
        code.append(
            f"void {name}_part{i}(const V* const* x, V* const* r, V* restrict w) {{\n"
            f"  (void) x; (void) r; (void) w;\n{places_of}{body}\n}}\n"
        )
    return code, shared
