"""All commands of the command line."""

from defsense_fab.cli.app import make_app


def all_commands():
    """Yield the words and the app of each command and group of commands, but not the program."""
    yield from _commands((), make_app())


def is_group(app):
    """Return whether a command only has further commands."""
    return app.default_command is None


def _commands(words, app):
    for name in app:
        if not name.startswith("-"):
            yield (*words, name), app[name]
            yield from _commands((*words, name), app[name])
