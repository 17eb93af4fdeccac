"""Command `defsense completion`: complete commands in a shell."""

from __future__ import annotations

import sys
from typing import Literal

from ..app import command, make_app
from ..output import standard_output

#: Leaves out the space after a folder, so that its content can be completed, and the backslashes
#: that bash puts before commas.
_BASH_WORDS = r"""
_defsense_words() {
  _defsense
  COMPREPLY=("${COMPREPLY[@]//\\,/,}")
  [[ ${#COMPREPLY[@]} -eq 1 && ${COMPREPLY[0]} == */ ]] && compopt -o nospace 2>/dev/null
  return 0
}
complete -F _defsense_words defsense
"""

completion = command("completion", "defsense completion bash")


@completion.default
def _completion(shell: Literal["bash", "zsh", "fish"], /) -> None:
    """Print a script that makes the Tab key complete commands.

    It completes commands, options, choices, files, and the names of devices, cords and materials.

    For bash, put the line eval "$(defsense completion bash)" into ~/.bashrc. For zsh, put the same
    with zsh into ~/.zshrc, after compinit. For fish, type defsense completion fish >
    ~/.config/fish/completions/defsense.fish.

    Args:
        shell: Set the shell that reads the script.
    """
    script = make_app().generate_completion(prog_name="defsense", shell=shell)
    with standard_output():
        sys.stdout.write(script + (_BASH_WORDS if shell == "bash" else ""))
