"""A statement says one thing: constructs at which a reader stops are not in the source, but for
kernels, where several coordinates of several disks are at hand at once.
"""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "src" / "brownpipe"
COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
# Rooms, and files of the engines, that are held to it. Kernels, and the files that they are in, are
# not.
PLAIN = (
    *("scene", "observables", "storage", "analysis", "tradeoff", "figures", "report", "inspection"),
    *("study", "verbs", "interface.py", "cli.py", "progress.py", "processes.py", "provenance.py"),
    *("text.py", "errors.py", "theory.py", "engines/__init__.py", "engines/confinement.py"),
    *("engines/ensemble.py", "engines/friction.py", "engines/start/initial_state.py"),
    *("engines/units.py", "engines/windows.py", "engines/exact/run.py"),
    *("engines/exact/simulation.py", "engines/timestep/simulation.py"),
)
COORDINATES = ({"x", "y"}, {"width", "height"}, {"low", "high"})


def several_at_once(statement):
    """Whether values are assigned at once that have nothing to do with each other."""
    if not (isinstance(statement, ast.Assign) and isinstance(statement.value, ast.Tuple)):
        return False
    if statement.col_offset == 0:  # constants of a module
        return False
    target = statement.targets[0]
    if not isinstance(target, ast.Tuple):
        return False
    names = {ast.unparse(item) for item in target.elts}
    is_swap = names == {ast.unparse(item) for item in statement.value.elts}
    return not is_swap and names not in COORDINATES


def nested_with_a_condition(node):
    """Whether a comprehension has another one in it, and a condition."""
    if not isinstance(node, COMPREHENSIONS):
        return False
    inner = [item for item in ast.walk(node) if isinstance(item, COMPREHENSIONS)]
    return len(inner) > 1 and any(loop.ifs for item in inner for loop in item.generators)


def assigned_within(node):
    """Whether a comprehension or a subscript assigns a name on the way."""
    if not isinstance(node, (*COMPREHENSIONS, ast.Subscript)):
        return False
    return any(isinstance(item, ast.NamedExpr) for item in ast.walk(node))


def splat_of_a_choice(node):
    """Whether arguments are added by `*(... if ... else ())`."""
    return isinstance(node, ast.Starred) and isinstance(node.value, ast.IfExp)


def choice_within_a_choice(node):
    """Whether `a if b else c` has another one in a or c."""
    return isinstance(node, ast.IfExp) and any(
        isinstance(item, ast.IfExp) for item in (node.body, node.orelse)
    )


def text_times_a_condition(node):
    """Whether a text is there or not by a product with a truth value."""
    if not (isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult)):
        return False
    sides = (node.left, node.right)
    has_text = any(
        isinstance(side, ast.JoinedStr)
        or (isinstance(side, ast.Constant) and isinstance(side.value, str))
        for side in sides
    )
    has_condition = any(isinstance(side, (ast.Compare, ast.BoolOp)) for side in sides)
    return has_text and has_condition


CONSTRUCTS = (
    several_at_once,
    nested_with_a_condition,
    assigned_within,
    splat_of_a_choice,
    choice_within_a_choice,
    text_times_a_condition,
)


def stops(source):
    """Yield the line and the name of each such construct in a source text."""
    for node in ast.walk(ast.parse(source)):
        for construct in CONSTRUCTS:
            if construct(node):
                yield node.lineno, construct.__name__


@pytest.mark.parametrize(
    ("source", "construct"),
    [
        ("def f(x, y):\n    a, b = g(x), h(y)", several_at_once),
        ("[[x for x in row if x] for row in rows]", nested_with_a_condition),
        ("[y for x in rows if (y := f(x))]", assigned_within),
        ("row[end : (end := end + 1)]", assigned_within),
        ("f(*([x] if x else ()))", splat_of_a_choice),
        ("a if b else c if d else e", choice_within_a_choice),
        ("' °' * (mark > 0)", text_times_a_condition),
    ],
)
def test_a_construct_is_found(source, construct):
    assert construct.__name__ in {name for _, name in stops(source)}


def test_unpacking_swaps_and_coordinates_are_no_stops():
    for plain in ("A, B = 1, 2", "a, b = pair", "a, b = b, a", "x, y = f(t), g(t)", "'-' * width"):
        assert list(stops(plain)) == []


@pytest.mark.parametrize("room", PLAIN)
def test_statements_are_plain(room):
    place = PACKAGE / room
    files = sorted(place.rglob("*.py")) if place.is_dir() else [place]
    found = [
        f"{file.relative_to(PACKAGE)}:{line}: {name}"
        for file in files
        for line, name in stops(file.read_text())
    ]
    assert files and found == []
