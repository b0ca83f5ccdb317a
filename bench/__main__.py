"""`python -m bench [--rounds N] [--seconds S] [--only PART]`."""

from __future__ import annotations

import sys

from bench.parts import main

sys.exit(main())
