#!/bin/bash
# Runs these tests inside a kernel that has vcan0, started for them; the root file system may be read-only.
cd "$(dirname "$0")/../.." || exit 1
export PYTHONPATH=$PWD PYTHONDONTWRITEBYTECODE=1 HYPOTHESIS_STORAGE_DIRECTORY=/run/hypothesis
netem=$(find /tmp -name 'sch_netem.ko*' 2>/dev/null | head -1)
[ -z "$netem" ] || busybox insmod "$netem"
exec .venv/bin/python -m pytest -q --color=no -m socketcan "${@:-tests/socketcan}"
