"""A law as a list of elementary operations, and as lines of text in an infix language.

`trace` runs a law's functions on CasADi symbols and reads the operations off; `write` turns them into assignments
that a person could have written: what is used once, or is as short as a name, stands where it is used.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from ohmloom.devices.laws import Law
from ohmloom.errors import OperationError

# Longest expression that is written in place of a name, in characters.
INLINE_LENGTH = 88
WIDTH = 110  # of emitted lines

INFIX = {"ADD": ("+", 4), "SUB": ("-", 4), "MUL": ("*", 5), "DIV": ("/", 5)}
COMPARISONS = {"LT": "<", "LE": "<=", "EQ": "==", "NE": "!="}
LOGICAL = {"AND": "&&", "OR": "||"}
FUNCTIONS = {
    "EXP": "exp", "LOG": "log", "POW": "pow", "CONSTPOW": "pow", "SQRT": "sqrt", "FABS": "fabs", "FMIN": "fmin",
    "FMAX": "fmax", "SIN": "sin", "COS": "cos", "TAN": "tan", "ASIN": "asin", "ACOS": "acos", "ATAN": "atan",
    "SINH": "sinh", "COSH": "cosh", "TANH": "tanh", "ASINH": "asinh", "ACOSH": "acosh", "ATANH": "atanh",
    "FLOOR": "floor", "CEIL": "ceil",
}  # fmt: skip
ATOM = 7
STATES = ("s", "v", "i", "u", "g")  # symbols that are no parameters


@dataclass(frozen=True)
class Operation:
    """One operation; `arguments` are indices of earlier ones, `leaf` is a symbol's name or a constant's value."""

    kind: str
    arguments: tuple[int, ...] = ()
    leaf: str | float = ""


@dataclass(frozen=True, kw_only=True)
class Program:
    """Operations in an order in which each finds its arguments done; `outputs` are (name, index), in order."""

    operations: tuple[Operation, ...]
    outputs: tuple[tuple[str, int], ...]

    @property
    def symbols(self) -> frozenset[str]:
        """Names of the symbols that are used."""
        return frozenset(str(step.leaf) for step in self.operations if step.kind == "INPUT")


@dataclass(frozen=True, kw_only=True)
class Assignment:
    """``name = text``; `is_fixed` if only parameters enter."""

    name: str
    text: str
    is_fixed: bool


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """How a language says what differs between languages.

    Attributes
    ----------
    functions
        How functions are called, ``{}`` for the arguments, where it is not as in C.
    variable
        ``name -> text`` that reads what changes with time.
    parameter
        ``name -> text`` that reads a parameter, or what follows from parameters alone, beside what changes with
        time; in an expression of parameters alone the name itself stands.
    """

    functions: Mapping[str, str]
    variable: Callable[[str], str] = str
    parameter: Callable[[str], str] = str


def trace(law: Law, *wanted: str) -> Program:
    """The operations behind `wanted`, out of these:

    ``conductance`` and ``charge_rate`` as the law has them, the latter in the symbols s, v and i; ``charge_scale``;
    ``i`` = conductance v; ``rate`` = charge_rate/charge_scale with that i, before walls; and ``conductance_by_s``,
    ``charge_rate_by_i`` and so on, the partial derivatives of the first two. Of a law with rounds also ``start``,
    ``advance`` and ``finish``, in the symbol u too; the derivatives of its conductance have the symbol g for that.

    Raises
    ------
    OperationError
        If the law uses an operation that no dialect knows.
    """
    import casadi

    names = (*STATES, *law.parameter_names)
    symbols = [casadi.SX.sym(name) for name in names]
    s, v, i, u, g, *p = symbols
    made = {"charge_rate": law.charge_rate(s, v, i, p), "charge_scale": law.charge_scale(p)}
    if law.rounds is not None:
        made |= {"start": law.rounds.start(s, v, p), "advance": law.rounds.advance(u, s, v, p),
                 "finish": law.rounds.finish(u, s, v, p)}  # fmt: skip
    if {"conductance", "i", "rate"} & set(wanted) or law.rounds is None:
        made["conductance"] = law.conductance(s, v, p)
        made["i"] = made["conductance"] * v
        made["rate"] = law.charge_rate(s, v, made["i"], p) / made["charge_scale"]
    for name in wanted:
        differentiated, by, symbol = name.rpartition("_by_")
        if not by:
            continue
        x = symbols[names.index(symbol)]
        if differentiated == "conductance" and law.rounds is not None:
            balance = casadi.SX(law.rounds.balance(g, s, v, p))
            made[name] = -casadi.jacobian(balance, x) / casadi.jacobian(balance, g)
        else:
            made[name] = casadi.jacobian(casadi.SX(made[differentiated]), x)
    function = casadi.Function("law", symbols, [casadi.SX(made[name]) for name in wanted])
    return _read_off(law.name, function, names, wanted)


def write(program: Program, dialect: Dialect) -> list[Assignment]:
    """`program` as assignments in `dialect`, temporaries named t0, t1, ... and each output under its own name."""
    return _Writer(program, dialect).assignments


def wrapped(statement: str, indent: int) -> str:
    """A statement on as many lines as it needs, where line ends mean nothing."""
    first, further = " " * indent, " " * (indent + 4)
    pieces = textwrap.wrap(
        statement,
        WIDTH,
        initial_indent=first,
        subsequent_indent=further,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return "\n".join(pieces)


@cache
def _kinds() -> dict[int, str]:
    import casadi

    return {getattr(casadi, name): name.removeprefix("OP_") for name in dir(casadi) if name.startswith("OP_")}


def _read_off(law_name: str, function: Any, names: tuple[str, ...], wanted: tuple[str, ...]) -> Program:
    """Walk a CasADi function's instructions; equal operations on equal arguments become one."""
    operations: list[Operation] = []
    known: dict[Operation, int] = {}
    outputs: dict[int, int] = {}
    register: dict[int, int] = {}
    for k in range(function.n_instructions()):
        kind = _kinds().get(function.instruction_id(k), "an unknown one")
        inputs, results = function.instruction_input(k), function.instruction_output(k)
        if kind == "OUTPUT":
            outputs[results[0]] = register[inputs[0]]
            continue
        if kind == "INPUT":
            step = Operation(kind, leaf=names[inputs[0]])
        elif kind == "CONST":
            step = Operation(kind, leaf=_finite(law_name, function.instruction_constant(k)))
        else:
            _check_known(law_name, kind)
            step = Operation(kind, tuple(register[index] for index in inputs))
            chosen = _chosen(operations, step)
            if chosen is not None:
                register[results[0]] = chosen
                continue
        if step not in known:
            known[step] = len(operations)
            operations.append(step)
        register[results[0]] = known[step]
    # An output that is zero for all inputs has no instruction of its own.
    for k in range(len(wanted)):
        if k not in outputs:
            outputs[k] = len(operations)
            operations.append(Operation("CONST", leaf=0.0))
    return _living(operations, [(name, outputs[k]) for k, name in enumerate(wanted)])


def _chosen(operations: list[Operation], step: Operation) -> int | None:
    """The index of ``x <= y`` if `step` is ``(x <= y)/((x <= y) + (y <= x))``, the slope of a smaller or larger value.

    They differ where x = y alone, where there is no slope.
    """
    if step.kind != "DIV" or operations[step.arguments[1]].kind != "ADD":
        return None
    first, both = step.arguments[0], operations[step.arguments[1]].arguments
    one, other = operations[first], operations[both[1]]
    is_choice = both[0] == first and one.kind == other.kind == "LE" and one.arguments == other.arguments[::-1]
    return first if is_choice else None


def _living(operations: list[Operation], outputs: list[tuple[str, int]]) -> Program:
    """The operations that outputs need, in their order."""
    needed = {index for _, index in outputs}
    for index in range(len(operations) - 1, -1, -1):
        if index in needed:
            needed.update(operations[index].arguments)
    place = {index: k for k, index in enumerate(sorted(needed))}
    return Program(
        operations=tuple(
            Operation(step.kind, tuple(place[k] for k in step.arguments), step.leaf)
            for step in (operations[index] for index in place)
        ),
        outputs=tuple((name, place[index]) for name, index in outputs),
    )


def _check_known(law_name: str, kind: str) -> None:
    known = {"NEG", "INV", "SQ", "TWICE", "NOT", "SIGN", "IF_ELSE_ZERO", *INFIX, *COMPARISONS, *LOGICAL, *FUNCTIONS}
    if kind not in known:
        raise OperationError(
            f"{law_name}: expected operations that C, SPICE and Verilog-A have, got CasADi's {kind}. "
            "Write the law with + - * / ** and the functions of ohmloom.devices.laws._functions."
        )


def _finite(law_name: str, value: float) -> float:
    if not math.isfinite(value):
        raise OperationError(f"{law_name}: expected finite constants, got {value}. Correct the law.")
    return float(value)


class _Writer:
    """Writes one program; the methods that end in `text` give an expression, `_put` its precedence too."""

    def __init__(self, program: Program, dialect: Dialect) -> None:
        self.operations, self.dialect = program.operations, dialect
        self.assignments: list[Assignment] = []
        self.is_fixed: list[bool] = []
        self.uses = [0] * len(self.operations)
        for step in self.operations:
            for index in step.arguments:
                self.uses[index] += 2 if step.kind in ("SQ", "SIGN") else 1
        self.names: dict[int, str] = {}
        self.put: dict[int, tuple[str, int]] = {}
        self.put_fixed: dict[int, tuple[str, int]] = {}
        outputs: dict[int, list[str]] = {}
        for name, index in program.outputs:
            outputs.setdefault(index, []).append(name)
        for index, step in enumerate(self.operations):
            self._step(index, step, outputs.get(index, []))

    def _step(self, index: int, step: Operation, outputs: list[str]) -> None:
        is_variable = step.kind == "INPUT" and step.leaf in STATES
        self.is_fixed.append(not is_variable and all(self.is_fixed[k] for k in step.arguments))
        fixed, is_leaf = self.is_fixed[index], not step.arguments
        if not is_leaf:
            self.put[index] = self._put(step, False)
        else:
            self._read_leaf(index, step)
        if fixed and not is_leaf:
            self.put_fixed[index] = self._put(step, True)
        for name in outputs:
            self._assign(index, name)
            if not is_leaf:
                self._read_by_name(index, name)
        if outputs or is_leaf:
            return
        is_short = step.kind in INFIX and all(not self.operations[k].arguments for k in step.arguments)
        if not is_short and (self.uses[index] > 1 or len(self.put[index][0]) > INLINE_LENGTH):
            name = f"t{sum(a.name[0] == 't' for a in self.assignments)}"
            self._assign(index, name)
            self._read_by_name(index, name)

    def _assign(self, index: int, name: str) -> None:
        fixed = self.is_fixed[index]
        text = (self.put_fixed if fixed else self.put)[index][0]
        self.assignments.append(Assignment(name=name, text=text, is_fixed=fixed))

    def _read_by_name(self, index: int, name: str) -> None:
        self.names[index] = name
        read = self.dialect.parameter if self.is_fixed[index] else self.dialect.variable
        self.put[index] = read(name), ATOM
        self.put_fixed[index] = name, ATOM

    def _read_leaf(self, index: int, step: Operation) -> None:
        if step.kind == "INPUT":
            self._read_by_name(index, str(step.leaf))
            return
        value = float(step.leaf)
        self.put[index] = self.put_fixed[index] = repr(value), ATOM if value >= 0 else 4

    def _put(self, step: Operation, fixed: bool) -> tuple[str, int]:
        kind, arguments = step.kind, step.arguments
        if kind in INFIX:
            sign, level = INFIX[kind]
            # Parentheses on the right keep the law's own order of roundings.
            first, second = self._text(arguments[0], fixed, level), self._text(arguments[1], fixed, level + 1)
            return f"{first} {sign} {second}", level
        if kind == "NEG":
            return f"-{self._text(arguments[0], fixed, ATOM)}", 4
        if kind == "INV":
            return f"1.0 / {self._text(arguments[0], fixed, 6)}", 5
        if kind == "TWICE":
            return f"2.0 * {self._text(arguments[0], fixed, 6)}", 5
        if kind == "SQ":
            factor = self._text(arguments[0], fixed, 6)
            return f"{factor} * {factor}", 5
        if kind == "IF_ELSE_ZERO":
            chosen = self._text(arguments[1], fixed, 1)
            return f"({self._condition(arguments[0], fixed)} ? {chosen} : 0.0)", ATOM
        if kind == "SIGN":
            x = self._text(arguments[0], fixed, 4)
            return f"({x} > 0.0 ? 1.0 : ({x} < 0.0 ? -1.0 : 0.0))", ATOM
        if kind in COMPARISONS or kind in LOGICAL or kind == "NOT":
            return f"({self._logic(step, fixed)} ? 1.0 : 0.0)", ATOM
        call = self.dialect.functions.get(FUNCTIONS[kind], FUNCTIONS[kind] + "({})")
        return call.format(", ".join(self._text(k, fixed, 0) for k in arguments)), ATOM

    def _text(self, index: int, fixed: bool, least: int) -> str:
        text, level = (self.put_fixed if fixed else self.put)[index]
        return text if level >= least else f"({text})"

    def _logic(self, step: Operation, fixed: bool) -> str:
        if step.kind in COMPARISONS:
            first, second = (self._text(k, fixed, 4) for k in step.arguments)
            return f"{first} {COMPARISONS[step.kind]} {second}"
        if step.kind == "NOT":
            return f"!({self._condition(step.arguments[0], fixed)})"
        first, second = (f"({self._condition(k, fixed)})" for k in step.arguments)
        return f"{first} {LOGICAL[step.kind]} {second}"

    def _condition(self, index: int, fixed: bool) -> str:
        """An operation as a truth value, not as a number."""
        step = self.operations[index]
        if index not in self.names and (step.kind in COMPARISONS or step.kind in LOGICAL or step.kind == "NOT"):
            return self._logic(step, fixed)
        return f"{self._text(index, fixed, 4)} != 0.0"
