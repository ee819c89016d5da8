"""Small faults for Python code: where an operator, a number, a condition or a call stands, by the syntax tree."""

from __future__ import annotations

import ast
from collections.abc import Iterator

_COMPARED: dict[type[ast.cmpop], tuple[str, str]] = {
    ast.Lt: ("<", "<="), ast.LtE: ("<=", "<"), ast.Gt: (">", ">="), ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="), ast.Is: (" is ", " is not "), ast.IsNot: (" is not ", " is "),
    ast.In: (" in ", " not in "), ast.NotIn: (" not in ", " in "),
}  # fmt: skip
_COMPUTED: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "+"), ast.Div: ("/", "*"), ast.FloorDiv: ("//", "*"),
    ast.Mod: ("%", "*"), ast.Pow: ("**", "*"),
}  # fmt: skip


def changes_of(text: str) -> Iterator[tuple[int, str, str]]:
    """(line from 1, kind, changed line) for every place that is on one line; not in type hints or docstrings."""
    lines = text.splitlines()
    for node in _executed(ast.parse(text)):
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            yield from _between(
                lines, node.left, node.comparators[0], _COMPARED.get(type(node.ops[0])), "comparison"
            )
        elif isinstance(node, ast.BinOp):
            yield from _between(lines, node.left, node.right, _COMPUTED.get(type(node.op)), "arithmetic")
        elif isinstance(node, ast.BoolOp):
            swap = (" and ", " or ") if isinstance(node.op, ast.And) else (" or ", " and ")
            yield from _between(lines, node.values[0], node.values[1], swap, "logic")
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            yield from _replaced(lines, node, f"({node.value!r} + 1)", "constant")
        elif isinstance(node, ast.If | ast.While | ast.IfExp):
            test = ast.get_source_segment(text, node.test)
            yield from _replaced(lines, node.test, f"(not ({test}))", "negated condition")
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            yield from _replaced(lines, node, "pass", "removed call")


def _executed(tree: ast.AST) -> Iterator[ast.AST]:
    """Every node below but annotations and what only a type checker reads."""
    for name, value in ast.iter_fields(tree):
        if name in ("annotation", "returns", "type_params"):
            continue
        for node in value if isinstance(value, list) else [value]:
            if not isinstance(node, ast.AST) or _is_for_types(node):
                continue
            yield node
            yield from _executed(node)


def _is_for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def _between(
    lines: list[str], left: ast.expr, right: ast.expr, swap: tuple[str, str] | None, kind: str
) -> Iterator[tuple[int, str, str]]:
    """The operator that stands between two operands."""
    if swap is None or left.end_lineno != right.lineno or left.end_col_offset is None:
        return
    line = lines[right.lineno - 1].encode()
    operator = line[left.end_col_offset : right.col_offset].decode()
    if swap[0] in operator:
        changed = operator.replace(*swap, 1).encode()
        yield right.lineno, kind, (line[: left.end_col_offset] + changed + line[right.col_offset :]).decode()


def _replaced(
    lines: list[str], node: ast.expr | ast.stmt, by: str, kind: str
) -> Iterator[tuple[int, str, str]]:
    if node.lineno == node.end_lineno:
        line = lines[node.lineno - 1].encode()
        changed = line[: node.col_offset] + by.encode() + line[node.end_col_offset :]
        yield node.lineno, kind, changed.decode()
