"""Whoever meets a message knows what to do: it says so, or docs/reference/faq.md does."""

import ast
import re
from pathlib import Path

import auroraqd

HOME = Path(__file__).parent.parent
SOURCE = Path(auroraqd.__file__).parent
FAQ = (HOME / "docs" / "reference" / "faq.md").read_text()
GAP = "..."  # what only the moment knows
INNER = ("raises AttributeError for what it has not", "_Broken", "_Refused", "Exit", "AttributeError", "NotImplementedError")
NAMES_IT = re.compile(r" (must|needs|takes|has no|is for|are for) .*|, got ")  # the argument, what was wanted, what came
SAYS_IT = re.compile(
    r"\b(choose|give|pip install|write|leave|call|say|trust|trusted|name it|name them|install|return|make it|use|run a)\b"
)


def messages():
    """Of what is raised and warned of in the package: place, and text with gaps."""
    for path in sorted(SOURCE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            call = node.exc if isinstance(node, ast.Raise) else node
            if not isinstance(call, ast.Call) or not call.args:
                continue
            kind = ast.unparse(call.func)
            if (isinstance(node, ast.Raise) and kind.rpartition(".")[2] not in INNER) or kind == "warnings.warn":
                text = said(call.args[0])
                if re.search(r"[a-z]{3,} [a-z]", text.replace(GAP, "")):  # not the words of another message alone
                    yield f"{path.relative_to(SOURCE)}:{node.lineno}", text


def said(node):
    """The text of an expression."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(said(part) for part in node.values)
    if isinstance(node, ast.BinOp):
        return said(node.left) + said(node.right)
    return GAP


def rows():
    """The messages in the tables of the page, each as the pieces between its gaps."""
    for line in FAQ.splitlines():
        if line.startswith("| "):
            for quoted in re.findall(r"`([^`]+)`", line.split(" | ")[0]):
                yield [piece.strip() for piece in quoted.split(GAP) if piece.strip()]


def in_order(pieces, text):
    """Whether all of them are in a text, one after the other."""
    start = 0
    for piece in pieces:
        found = text.find(piece, start)
        if found < 0:
            return False
        start = found + len(piece)
    return True


def test_each_message_says_what_to_do_or_the_page_does():
    known = list(rows())
    assert len(known) > 90
    unknown = [
        f"{place}: {text}"
        for place, text in messages()
        if not (NAMES_IT.search(text) or SAYS_IT.search(text) or any(in_order(pieces, text) for pieces in known))
    ]
    assert not unknown, "\n".join(unknown)


def test_the_page_has_no_message_that_nobody_sees():
    source = "\n".join(text for _, text in messages())
    source += "\n".join(path.read_text() for path in SOURCE.rglob("*.py"))
    unseen = [" ... ".join(pieces) for pieces in rows() if not all(piece in source for piece in pieces)]
    assert not unseen
