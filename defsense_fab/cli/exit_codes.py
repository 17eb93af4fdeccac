"""Exit codes of all commands, as docs/commands.md lists them."""

#: Success.
DONE = 0
#: The answer is no: `capture camera check` found that the calibration does not hold, or
#: `board check` that a channel needs attention.
NO = 1
#: The input or the machine does not allow the command; an error was printed.
REFUSED = 2
#: Interrupted by Ctrl-C (128 + SIGINT, as in shells).
STOPPED = 130
