#!/bin/bash
# Installs what is missing (once), builds, runs every test.
set -euo pipefail
cd "$(dirname -- "${BASH_SOURCE[0]}")/.."

bash third_party_notes/install.sh
cmake --preset release > build.log 2>&1 || { cat build.log; exit 1; }
rm -f build.log
cmake --build --preset release
ctest --preset release "$@"
