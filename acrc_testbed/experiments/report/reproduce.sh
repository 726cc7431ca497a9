#!/bin/sh
# Makes the runs of this bundle again and compares their digests.
#
#   ./reproduce.sh        all of them
#   ./reproduce.sh 2      those of the first two seeds
#
# ACRC=/path/to/acrc ./reproduce.sh uses a testbed that is already there, in place of the one in software.zip.
# An interrupted call goes on where it was.
set -eu
cd -- "$(dirname -- "$0")"
if [ -z "${ACRC:-}" ]; then
    if [ ! -f software.zip ]; then
        echo 'This bundle has no software.zip; call it with ACRC=/path/to/acrc, at the commit that README.md names.' >&2
        exit 2
    fi
    [ -d software ] || python3 -m zipfile -e software.zip software
    chmod +x software/acrc
    ACRC=./software/acrc
fi
# The study's strategies lie in this bundle: whoever calls this script runs them.
"$ACRC" campaign study.json --trust --out reproduced ${1:+--seeds "$1"}
python3 check_digests.py results reproduced
