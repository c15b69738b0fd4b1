"""Lines of code and named numbers of a checkout, by package: `python tests/code_size.py [CHECKOUT]`.

A line of code is neither blank nor part of a comment or docstring. A named number is a name that a module
assigns at its top level to a number or to an expression of numbers only; a tuple of numbers counts once.
"""

import ast
import io
import sys
import tokenize
from collections import Counter
from pathlib import Path

PACKAGES = "derive", "models", "solve", "tests"

_LAYOUT = (
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.COMMENT,
    tokenize.ENDMARKER,
)


def code_lines(text: str) -> int:
    """Number of lines of code."""
    strings = {
        number
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
        for number in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    lines = {
        number
        for token in tokens
        if token.type not in _LAYOUT
        for number in range(token.start[0], token.end[0] + 1)
    }
    return len(lines - strings)


def named_numbers(text: str) -> list[str]:
    """Names that a module assigns to numbers."""
    names: list[str] = []
    for node in ast.parse(text).body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for target in targets:
                names += [name for name, value in _pairs(target, node.value) if _is_number(value, names)]
    return names


def _pairs(target: ast.expr, value: ast.expr) -> list[tuple[str, ast.expr]]:
    """Names and values of an assignment."""
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        return [pair for part in zip(target.elts, value.elts, strict=False) for pair in _pairs(*part)]
    return [(target.id, value)] if isinstance(target, ast.Name) else []


def _is_number(node: ast.expr, names: list[str]) -> bool:
    """Whether an expression consists of numbers and named numbers only."""
    match node:
        case ast.Constant(value=bool()):
            return False
        case ast.Constant(value=int() | float() | complex()):
            return True
        case ast.Name(id=name):
            return name in names
        case ast.Attribute(value=ast.Name(id="math" | "np"), attr="pi" | "e" | "inf"):
            return True
        case ast.Attribute(value=ast.Call(func=ast.Attribute(attr="finfo" | "iinfo"))):
            return True
        case ast.UnaryOp(operand=operand):
            return _is_number(operand, names)
        case ast.BinOp(left=left, right=right):
            return _is_number(left, names) and _is_number(right, names)
        case ast.Call(func=ast.Name(id="float" | "int") | ast.Attribute(), args=[*values]) if values:
            return all(_is_number(value, names) for value in values)
        case ast.Tuple(elts=[*values]) | ast.List(elts=[*values]) if values:
            return all(_is_number(value, names) for value in values)
    return False


def main(checkout: Path) -> None:
    """Print the counts of the packages of a checkout, and of the packages inside `solve` and `models`."""
    lines: Counter[str] = Counter()
    files: Counter[str] = Counter()
    numbers: Counter[str] = Counter()
    for path in sorted(path for package in PACKAGES for path in (checkout / package).rglob("*.py")):
        place = path.relative_to(checkout).parts
        text = path.read_text(encoding="utf-8")
        inner = ["/".join(place[:2])] if len(place) > 2 and place[0] in ("models", "solve") else []
        for package in (place[0], *inner):
            lines[package] += code_lines(text)
            files[package] += 1
            numbers[package] += len(named_numbers(text))
    print(f"{'package':<24}{'code lines':>12}{'files':>8}{'named numbers':>16}")
    for package in sorted(lines):
        print(f"{package:<24}{lines[package]:>12}{files[package]:>8}{numbers[package]:>16}")
    print(f"{'named numbers outside tests':<44}{sum(numbers[name] for name in PACKAGES[:-1]):>16}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
