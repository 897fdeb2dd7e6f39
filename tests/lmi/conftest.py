"""Makes the cases here and what tests share between rooms importable: these tests are no package."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), *(str(one) for one in sorted(HERE.iterdir()) if one.is_dir())]
