"""`python -m tinysplat_runtime` is the command `tinysplat`."""

import sys

from .cli import main

sys.exit(main())
