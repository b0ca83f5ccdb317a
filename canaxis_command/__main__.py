"""`python -m canaxis_command` is `canaxis`."""

from __future__ import annotations

from canaxis_command import main

if __name__ == "__main__":
    main()
