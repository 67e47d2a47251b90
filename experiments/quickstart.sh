#!/bin/bash
# From a bare machine to a first jammed packing: installs what is missing (once),
# builds, jams 1024 discs (radii of two sizes, none quite equal) and draws them.
#
#   experiments/quickstart.sh [flags of the jamming experiment]
set -euo pipefail
cd "$(dirname -- "${BASH_SOURCE[0]}")/.."

bash third_party_notes/install.sh
echo "building (about a minute the first time)"
cmake --preset release > build.log 2>&1 || { cat build.log; exit 1; }
rm -f build.log
cmake --build --preset release --target relax jamming
build/release/experiments/jamming --particles=1024 --polydispersity=1e-3 \
  --out=out/quickstart "$@"
