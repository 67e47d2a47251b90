#!/bin/bash
# Reproduces every figure and table of both papers, and what goes beyond them, on one
# page that needs no network: report/index.html. Installs what is missing (once) and
# builds first. What was done before is kept; stopped, the same command goes on.
#
#   bash experiments/reproduce.sh [--smoke] [--jobs=N] [--only=fig8,flow] [--list]
#
#   --smoke   systems of seconds, to see that everything works (minutes in all)
#   --jobs    studies at a time
#   --help    all flags
#
# Exit status: 0 all studies are on the page; 1 some are not (the page says which);
# 2 bad flags.
set -euo pipefail
cd "$(dirname -- "${BASH_SOURCE[0]}")/.."

runner=experiments/reproduction/run.py
for argument in "$@"; do
  case "${argument}" in
    -h | --help | --list | --page) exec python3 "${runner}" "$@" ;;
  esac
done
bash third_party_notes/install.sh
cmake --preset release > build.log 2>&1 || { cat build.log; exit 1; }
rm -f build.log
cmake --build --preset release --target \
  compare jamming scaling conditioning shear flow identify tradeoff extremes fidelity
exec python3 "${runner}" "$@"
