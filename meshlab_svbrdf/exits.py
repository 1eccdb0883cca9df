"""Exit codes of the shell's commands."""

ERROR = 1
"""An error of the input, which is said without a traceback."""
USAGE = 2
"""The command line itself is not taken: typer's."""
BUSY = 75
"""Another run has the project: EX_TEMPFAIL of sysexits.h."""
INTERRUPTED = 130
"""128 and the number of SIGINT."""
