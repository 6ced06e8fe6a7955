"""`python -m observer_fi` is the command `observer-fi`."""

import sys

from observer_fi.cli import main

if __name__ == "__main__":
    sys.exit(main())
