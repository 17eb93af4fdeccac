"""What the command's exit tells a shell; docs/commands.md has the same list."""

#: Done; the answer is no (`capture camera check`); refused; stopped by Ctrl-C, as shells have it.
DONE, NO, REFUSED, STOPPED = 0, 1, 2, 130
