"""Run the command line: `python -m defsense_fab` is the same as `defsense`."""

import sys

from .cli.main import main

if __name__ == "__main__":
    sys.exit(main())
