#!/bin/sh
# Repeats the runs of this bundle and compares their digests.
#
#   ./reproduce.sh        all runs
#   ./reproduce.sh 2      runs of the first two seeds
#
# ACRC=/path/to/acrc ./reproduce.sh uses an installed testbed instead of software.zip.
# Call it again after an interruption to resume.
set -eu
cd -- "$(dirname -- "$0")"
if [ -z "${ACRC:-}" ]; then
    if [ ! -f software.zip ]; then
        echo 'This bundle has no software.zip; set ACRC=/path/to/acrc to a testbed at the commit in README.md.' >&2
        exit 2
    fi
    [ -d software ] || python3 -m zipfile -e software.zip software
    chmod +x software/acrc
    ACRC=./software/acrc
fi
# --trust: strategies of this bundle are executed.
"$ACRC" campaign study.json --trust --out reproduced ${1:+--seeds "$1"}
python3 check_digests.py results reproduced
