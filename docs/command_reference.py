"""The commands of `defsense`, by task, from the command line's own declarations.

`make guide` puts their tables where a page says ```{commands}```.
"""

from sphinx.util.docutils import SphinxDirective

from defsense_fab.cli import app as command_line


def list_commands(app, words=()):
    """Yield the words and the app of each command that runs, in the order of the help."""
    for name in app:
        if name.startswith("-"):
            continue
        command = app[name]
        if command.default_command is None:
            yield from list_commands(command, (*words, name))
        else:
            yield (*words, name), command


def markdown():
    """Return a section with a table for each task."""
    app, sections = command_line.make_app(), {}
    for words, command in list_commands(app):
        (group,) = app[words[0]].group
        title = group if isinstance(group, str) else group.name
        what = command.help.splitlines()[0]
        example = f"`{command.examples[0]}`" if getattr(command, "examples", ()) else ""
        sections.setdefault(title, []).append(f"| `{' '.join(words)}` | {what} | {example} |")
    head = "| command | what it does | example |\n|---|---|---|\n"
    return "\n\n".join(
        f"### {title}\n\n{head}" + "\n".join(rows) for title, rows in sections.items()
    )


class Commands(SphinxDirective):
    """The tables, in place of the directive."""

    has_content = True  # shown where the Markdown is read without the site

    def run(self):
        """Return the tables as nodes; Sphinx calls this."""
        self.env.note_dependency(command_line.__file__)
        return self.parse_text_to_nodes(markdown(), allow_section_headings=True)
