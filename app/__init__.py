"""The program: the only package that wires, prints, draws and parses."""

import sys

# Before any import that an older interpreter could not parse; pip refuses these, `python3 -m
# layflat.app.commands.doctor` does not.
if sys.version_info < (3, 10):  # noqa: UP036
    sys.exit(f"Layflat needs Python 3.10 to 3.13; this is Python {sys.version_info[0]}.{sys.version_info[1]}.")
