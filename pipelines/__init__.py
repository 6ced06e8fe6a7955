"""One script a study, each a recipe: `python -m pipelines.NAME` from the root of a checkout.

The studies judge against `tests/hidden`, a truth that shares no code with the package; it is imported as the tests import it.
"""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent / "tests"))
