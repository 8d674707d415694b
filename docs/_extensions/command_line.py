"""The directive `command`: what `auroraqd COMMAND --help` says, as a part of a page, read from the command itself."""

import inspect

import typer
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.errors import SphinxError
from sphinx.util.docutils import SphinxDirective

from auroraqd.cli import app

_COMMANDS = typer.main.get_command(app).commands
_TOLD = "commands told"  # of the environment: of each page, those it has


class Command(SphinxDirective):
    """Usage, purpose and parameters of a command."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """See Sphinx."""
        name = self.arguments[0]
        if name not in _COMMANDS:
            raise self.error(f"there is no command {name}; there are {', '.join(_COMMANDS)}")
        told = self.env.metadata.setdefault(self.env.docname, {})
        told[_TOLD] = f"{told.get(_TOLD, '')} {name}"
        command = _COMMANDS[name]
        arguments = [_metavar(one) for one in command.params if _is_argument(one)]
        usage = " ".join(["auroraqd", name, *arguments, "[OPTIONS]"])
        said: list[nodes.Node] = [nodes.literal_block(usage, usage, language="text")]
        for paragraph in inspect.cleandoc(command.help or "").split("\n\n"):
            said += _said(paragraph.replace("\n", " "))
        items = [_item(one) for one in command.params if one.name != "help"]
        return [*said, nodes.definition_list("", *items)]


def _is_argument(parameter: object) -> bool:
    return getattr(parameter, "param_type_name", "") == "argument"


def _metavar(parameter: object) -> str:
    return parameter.name.upper() + ("..." if getattr(parameter, "nargs", 1) == -1 else "")


def _said(paragraph: str) -> list[nodes.Node]:
    """A paragraph, and its example, if it ends in one, as a block."""
    text, example, command = paragraph.partition("Example: ")
    found: list[nodes.Node] = [nodes.paragraph("", text.strip())] if text.strip() else []
    return [*found, nodes.literal_block(command, command, language="bash")] if example else found


def _item(parameter: object) -> nodes.definition_list_item:
    names = [_metavar(parameter)] if _is_argument(parameter) else [*parameter.opts, *parameter.secondary_opts]
    term = nodes.term("")
    for index, name in enumerate(names):
        term += [*([nodes.Text(", ")] if index else []), nodes.literal(name, name)]
    text, default = parameter.help or "", parameter.default
    if default is not None and not parameter.required and not isinstance(default, bool):
        text += f" [default: {default:g}]" if isinstance(default, float) else f" [default: {default}]"
    return nodes.definition_list_item("", term, nodes.definition("", nodes.paragraph("", text)))


def _check_all_told(app: Sphinx, environment: object) -> None:
    told = {name for page in environment.metadata.values() for name in page.get(_TOLD, "").split()}
    missing = set(_COMMANDS) - told
    if missing:
        raise SphinxError(f"no page tells of the commands {', '.join(sorted(missing))}")


def setup(app: Sphinx) -> dict:
    """As Sphinx wants it."""
    app.add_directive("command", Command)
    app.connect("env-updated", _check_all_told)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
