"""Messages of the package, read from its source: errors, warnings before a run, notes of a run."""

import ast
import re
from collections.abc import Iterable, Iterator
from itertools import product
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).parents[2] / "sepmc"
_MOST = 6  # alternatives of a text that depends on conditions
# functions whose result is part of a message, with the text they stand for
_CALLS = {
    "another_place": "use --overwrite or another --out",
    "nearest": "did you mean NAME?",
    "flying_again": "sepmc campaign FOLDER --out FOLDER --resume",
    "exists": "PATH: exists; add --overwrite to replace it, or choose another --out",
}
NOTE, PROBLEM = "note", "problem"
ARGUMENT_ERRORS = ("InputError", "UsageError", "SceneError")
FOLDER_ERRORS = (
    "StoreError",
    "OtherFormatError",
    "MissingColumnError",
    "ClusterError",
    "StaleWorkerError",
    "PathError",
)
# modules whose texts are warnings or notes, all of them or those of some functions
NOTES = {
    "analysis/rare_values.py": (),
    "analysis/subset_simulation.py": (),
    "campaign/estimation.py": ("_sigma_notes", "_mixing_notes"),
    "campaign/execution/diagnostics.py": (),
    "campaign/execution/missing_events.py": (),
    "campaign/execution/rare_event.py": ("_notes", "_error_notes"),
    "campaign/execution/step_refinement.py": (),
    "campaign/execution/table_overshoot.py": (),
    "campaign/execution/runner.py": ("implausible_note",),
    "engine/threads.py": ("fork_notes",),
    "scene/lint.py": (),
    "scene/lint_aerodynamics.py": (),
    "scene/lint_layout.py": (),
    "scene/read.py": ("_no_effect_notes",),
    "scene/redundancy.py": (),
}
# parts of messages that stand in other functions
_PARTS = re.compile(
    r"NAME \(probability|FIRST of CASES|ACCEPTANCE at|replica K|COUNT cases by|, at an end|"
    r"the (nominal case|run) ends|motor.NAME \(cant|KEY does not|spring.NAME does not reach|"
    r"TABLE.NAME |"
    r"LOW to HIGH|the smooth function reaches AT between"
)
_GLUED = re.compile(r"(?<=[a-z?])[A-Z_]{3,}\b")  # a clause that not all messages have
_SHORT = re.compile(r"[A-Za-z_]\w*")


class Message(NamedTuple):
    """Message of the package.

    Attributes
    ----------
    kind : str
        Class of an error, ``problem`` of a file, or `NOTE`: a warning or note.
    module : str
        Path within the package.
    text : str
        With values as words in capitals.
    """

    kind: str
    module: str
    text: str


class _Texts(ast.NodeVisitor):
    """Texts of a module: what its functions raise, add to problems, yield or return."""

    def __init__(self, module: str, source: str, constants: dict[str, str]):
        self.module, self.constants = module, constants
        self.messages: list[Message] = []
        self.scopes: list[dict[str, list[ast.expr]]] = [{}]
        tree = ast.parse(source)
        outer = [node for node in tree.body if not isinstance(node, ast.FunctionDef | ast.ClassDef)]
        self.scopes[0] = _assigned(ast.Module(outer, []))
        self.of_functions = NOTES.get(module)
        self.notes = self.of_functions == ()
        self.visit(tree)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self.scopes.append(_assigned(node))
        outside, self.notes = self.notes, self.notes or node.name in (self.of_functions or ())
        for statement in node.body:
            self.visit(statement)
        self.notes = outside
        self.scopes.pop()

    def visit(self, node: ast.AST) -> None:
        if self.notes and isinstance(node, ast.expr) and _is_text(node):
            self.add(NOTE, node)
            return
        super().visit(node)

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):  # no docstring
            self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        if not _is_text(node.value) and not isinstance(node.value, ast.Tuple | ast.Dict):
            self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> None:
        if isinstance(node.exc, ast.Call) and node.exc.args:
            kind = ast.unparse(node.exc.func).rpartition(".")[2]
            self.add(kind, node.exc.args[0])

    def visit_Call(self, node: ast.Call) -> None:
        name = ast.unparse(node.func)
        if name == "problems.add" and len(node.args) > 1:
            self.add(PROBLEM, node.args[1])
        if name == "warn" and node.args:
            self.add(NOTE, node.args[0])
        self.generic_visit(node)

    def add(self, kind: str, node: ast.expr) -> None:
        """Add the texts of an expression that are sentences."""
        for text in self.texts(node):
            message = Message(kind, self.module, _GLUED.sub("", " ".join(text.split())))
            minimum = 4 if kind == NOTE else 2  # words
            is_part = kind == NOTE and _PARTS.match(message.text)
            if len(text.split()) >= minimum and not is_part and message not in self.messages:
                self.messages.append(message)

    def texts(self, node: ast.expr | None, depth: int = 0) -> list[str]:  # noqa: PLR0911
        """Texts that an expression can have, values as words in capitals."""
        if isinstance(node, ast.Constant):
            return [str(node.value)]
        if isinstance(node, ast.FormattedValue):
            return self.texts(node.value, depth)
        if isinstance(node, ast.JoinedStr):
            parts = [self.texts(value, depth) for value in node.values]
            return ["".join(some) for some in list(product(*parts))[:_MOST]]
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
            pairs = product(self.texts(node.left, depth), self.texts(node.right, depth))
            return ["".join(some) for some in list(pairs)[:_MOST]]
        if isinstance(node, ast.IfExp):
            return self.texts(node.body, depth) + self.texts(node.orelse, depth)
        if isinstance(node, ast.List):
            return [text for item in node.elts for text in self.texts(item, depth)]
        if isinstance(node, ast.ListComp):
            return self.texts(node.elt, depth)
        if isinstance(node, ast.Name) and depth < 3:
            for scope in reversed(self.scopes):
                values = [v for v in _reaching(scope.get(node.id, []), node) if _is_text(v)]
                if values:
                    return [text for v in values for text in self.texts(v, depth + 1)]
        if isinstance(node, ast.Name | ast.Attribute):
            name = node.id if isinstance(node, ast.Name) else node.attr
            if name in self.constants:
                return [self.constants[name]]
        return [_placeholder(node)]


def _assigned(node: ast.AST) -> dict[str, list[ast.expr]]:
    """Expressions that are assigned to each name in a function or module, and the places where the
    name is used."""
    values: dict[str, list[ast.expr]] = {}
    for item in ast.walk(node):
        if isinstance(item, ast.Name) and isinstance(item.ctx, ast.Load):
            values.setdefault(item.id, []).append(item)
        if isinstance(item, ast.NamedExpr):
            values.setdefault(item.target.id, []).append(item.value)
        if isinstance(item, ast.Assign):
            for target in item.targets:
                for name, value in _pairs(target, item.value):
                    values.setdefault(name, []).append(value)
    return values


def _reaching(places: list[ast.expr], use: ast.Name) -> list[ast.expr]:
    """Of the texts and uses of a name, the texts between its last use before ``use`` and that; all
    earlier ones if there are none."""
    before = [p for p in places if (p.lineno, p.col_offset) < (use.lineno, use.col_offset)]
    texts = [p for p in before if not isinstance(p, ast.Name)]
    last = max((p.lineno for p in before if isinstance(p, ast.Name)), default=0)
    return [p for p in texts if p.lineno > last] or texts or places


def _pairs(target: ast.expr, value: ast.expr) -> Iterator[tuple[str, ast.expr]]:
    if isinstance(target, ast.Name):
        yield target.id, value
    elif isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        for one, item in zip(target.elts, value.elts, strict=False):
            yield from _pairs(one, item)


def _is_text(node: ast.expr) -> bool:
    """True for an expression that is a text as written."""
    if isinstance(node, ast.IfExp):
        return _is_text(node.body) or _is_text(node.orelse)
    if isinstance(node, ast.BinOp):
        return _is_text(node.left) or _is_text(node.right)
    if isinstance(node, ast.Call):
        return ast.unparse(node.func).rpartition(".")[2] in _CALLS
    return isinstance(node, ast.JoinedStr) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str)
    )


def _placeholder(node: ast.expr | None) -> str:
    """Word in capitals for a value; the text of a function of `_CALLS`, and options as typed."""
    if isinstance(node, ast.Call):
        name = ast.unparse(node.func).rpartition(".")[2]
        if name in _CALLS:
            return _CALLS[name]
        first = node.args[0] if node.args else None
        if name in ("option", "switch", "setting") and isinstance(first, ast.Constant):
            flag = "--set" if name == "setting" else "--" + str(first.value).replace("_", "-")
            return f"{flag} {first.value}=VALUE" if name == "setting" else flag
    names = _SHORT.findall(ast.unparse(node)) if node else []
    return names[-1].strip("_").upper() if names else "VALUE"


def _constants(files: Iterable[Path]) -> dict[str, str]:
    """Texts that modules define under names in capitals."""
    texts = {}
    for file in files:
        for name, values in _assigned(ast.parse(file.read_text(encoding="utf-8"))).items():
            value = values[0]
            if name.isupper() and isinstance(value, ast.Constant) and isinstance(value.value, str):
                texts[name] = value.value
    return texts


def read_messages() -> list[Message]:
    """Messages of the package, in the order of its modules."""
    files = sorted(PACKAGE.rglob("*.py"))
    messages, constants = [], _constants(files)
    for file in files:
        module, source = file.relative_to(PACKAGE).as_posix(), file.read_text(encoding="utf-8")
        messages += _Texts(module, source, constants).messages
    return messages


def with_remedies(
    messages: Iterable[Message], remedies: dict[str, str]
) -> dict[str, list[Message]]:
    """Messages by the pattern of their remedy, the first that they match; "" without any."""
    groups: dict[str, list[Message]] = {pattern: [] for pattern in remedies} | {"": []}
    for message in messages:
        pattern = next((p for p in remedies if re.search(p, message.text)), "")
        groups[pattern].append(message)
    return groups


def message_table(kinds: Iterable[str], remedies: dict[str, str]) -> list[tuple[str, str]]:
    """Rows of a table: messages of some kinds that share a remedy, and the remedy."""
    groups = with_remedies((m for m in read_messages() if m.kind in kinds), remedies)
    return [
        ("<br>".join(dict.fromkeys(f"`{m.text}`" for m in group)), remedies[pattern])
        for pattern, group in groups.items()
        if pattern
    ]


def message_list(kinds: Iterable[str]) -> list[tuple[str, list[str]]]:
    """Messages of some kinds by the module they are from."""
    lists: dict[str, list[str]] = {}
    for message in read_messages():
        if message.kind in kinds:
            texts = lists.setdefault(message.module, [])
            if message.text not in texts:
                texts.append(message.text)
    return list(lists.items())
