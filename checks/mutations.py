"""Every single-line bug of a module: an operator for its neighbour, a number off by one, a condition denied.

cosmic-ray makes those of Python, and not mutmut, which rewrites whole modules into trampolines, wants its own copy of
the package on the path and has no test command of each module's own. Those of JavaScript are exchanges of words,
shaders' text included.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cosmic_ray import plugins
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code

SWAPS = ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "FloorDiv_Div", "Mod_Mul", "Pow_Mul", "LShift_RShift",
         "RShift_LShift", "BitAnd_BitOr", "BitXor_BitAnd")  # fmt: skip
"""Of cosmic-ray's 130 exchanges of a binary operator, one for each; `|` is left to annotations."""

COMPARISONS = ("Lt_LtE", "LtE_Lt", "Gt_GtE", "GtE_Gt", "Lt_Gt", "Gt_Lt", "LtE_Gt", "GtE_Lt", "Eq_NotEq", "NotEq_Eq")
OTHERS = (
    "AddNot",
    "NumberReplacer",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ReplaceFalseWithTrue",
    "ReplaceTrueWithFalse",
    "ReplaceUnaryOperator_USub_UAdd",
    "ZeroIterationForLoop",
)

WORDS = {
    " + ": " - ", " - ": " + ", " * ": " / ", " / ": " * ", " % ": " * ", " ** ": " * ", " << ": " >> ", " >> ": " << ",
    " >>> ": " << ", " & ": " | ", " | ": " & ", " ^ ": " & ", " && ": " || ", " || ": " && ", " ?? ": " && ",
    " < ": " <= ", " <= ": " < ", " > ": " >= ", " >= ": " > ", " === ": " !== ", " !== ": " === ", " == ": " != ",
    " += ": " -= ", " -= ": " += ", " *= ": " /= ", "true": "false", "false": "true", "Math.min": "Math.max",
    "Math.max": "Math.min", "Math.floor": "Math.ceil", "Math.ceil": "Math.floor", "if (": "if (!", "-": "+",
}  # fmt: skip
NOT_CODE = r"//[^\n]*|/\*.*?\*/|\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*'|^import [^;]*;"
NOT_CODE += r"|^#version[^\n]*|^precision [^\n]*"
CODE = r" (?:\*\*|<<|>>>|>>|&&|\|\||\?\?|<=|>=|===|!==|==|\+=|-=|\*=|[-+*/%&|^<>]) |\b(?:true|false)\b"
CODE += r"|Math\.(?:min|max|floor|ceil)\b|\bif \((?=[\w.]+\))|(?<=[(\[])-(?=[\w(])"
NUMBER = r"(?<![\w.$])\d+(?:\.\d+)?(?![\w.])"
TOKENS = re.compile(rf"(?P<skipped>{NOT_CODE})|(?P<number>{NUMBER})|(?P<word>{CODE})", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Mutation:
    """One bug: where (relative to the checkout; lines from 1), what, and the how-manieth of its kind in the module."""

    path: Path
    line: int
    column: int
    what: str
    occurrence: int

    @property
    def place(self) -> str:
        return f"{self.path}:{self.line}:{self.column} {self.what}"


def mutations(root: Path, path: Path) -> Iterator[Mutation]:
    """All of the module at `root / path`."""
    text = (root / path).read_text(encoding="utf-8")
    return _of_python(path, text) if path.suffix == ".py" else _of_javascript(path, text)


def mutated(text: str, mutation: Mutation) -> str:
    """The module's text with the bug in it."""
    if mutation.path.suffix == ".py":
        return str(mutate_code(text, plugins.get_operator(f"core/{mutation.what}")(), mutation.occurrence))
    token = list(_tokens(text))[mutation.occurrence]
    return text[: token.start()] + _instead(token) + text[token.end() :]


def has_effect(text: str, mutation: Mutation) -> bool:
    """Whether a bug changes what a module does: not how a number is written, whether `zip` counts, how printing is
    flushed, or which arguments may be told by name. What does not even compile is no bug."""
    return mutation.path.suffix != ".py" or _does(mutated(text, mutation)) not in ("", _does(text))


def _does(text: str) -> str:
    try:
        tree = ast.parse(text)
    except SyntaxError:
        return ""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            node.keywords = [word for word in node.keywords if word.arg not in ("strict", "flush")]
        elif isinstance(node, ast.arguments):
            node.args = [*node.posonlyargs, *node.args, *node.kwonlyargs]
            node.defaults = [*node.defaults, *filter(None, node.kw_defaults)]
            node.posonlyargs, node.kwonlyargs, node.kw_defaults = [], [], []
    return ast.dump(tree)


def _of_python(path: Path, text: str) -> Iterator[Mutation]:
    nodes, lines = list(ast_nodes(get_ast(text))), text.splitlines()
    known = set(plugins.operator_names())
    names = [f"ReplaceBinaryOperator_{swap}" for swap in SWAPS]
    names += [f"ReplaceComparisonOperator_{swap}" for swap in COMPARISONS]
    for name in (name for name in (*names, *OTHERS) if f"core/{name}" in known):
        operator = plugins.get_operator(f"core/{name}")()
        places = [start for node in nodes for start, _ in operator.mutation_positions(node)]
        for occurrence, (line, column) in enumerate(places):
            if not lines[line - 1].lstrip().startswith("@"):  # what decorators are told is no arithmetic
                yield Mutation(path, line, column, name, occurrence)


def _tokens(text: str) -> Iterator[re.Match[str]]:
    return (token for token in TOKENS.finditer(text) if not token["skipped"])


def _instead(token: re.Match[str]) -> str:
    return WORDS[token["word"]] if token["word"] else str((float if "." in token[0] else int)(token[0]) + 1)


def _of_javascript(path: Path, text: str) -> Iterator[Mutation]:
    for occurrence, token in enumerate(_tokens(text)):
        line, column = text.count("\n", 0, token.start()) + 1, token.start() - text.rfind("\n", 0, token.start()) - 1
        yield Mutation(path, line, column, f"`{token[0].strip()}` → `{_instead(token).strip()}`", occurrence)
