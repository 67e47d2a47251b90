#!/bin/bash
# How far each method gets before it ends by itself: max|g| / mean force, judged
# in quadruple precision, at pressures from 1e-3 to 1e-8 (k = 1, box = 1). Jams N
# discs, compresses them to each pressure, displaces every coordinate by up to one
# mean overlap, relaxes with tolerance 1e-15. Prints a table and the last words of
# each method; keeps everything in FOLDER.
#
#   experiments/floors.sh [N=1024 [SEED=1 [FOLDER=out/floors]]]
set -euo pipefail
cd "$(dirname -- "${BASH_SOURCE[0]}")/.."
n="${1:-1024}"
seed="${2:-1}"
folder="${3:-out/floors}"
binaries=build/release/experiments
pressures="1e-3 1e-4 1e-5 1e-6 1e-7 1e-8"
methods="lbfgs
ncg
fire
newton
interior_point
ceres_lbfgs
ceres_lbfgs:scaled=1
ceres_lbfgs:scaled=1,differences=1
ceres_lbfgs:scaled=1,differences=1,restarts=10
ceres_ncg
ceres_ncg:scaled=1
ceres_ncg:scaled=1,differences=1,restarts=10
liblbfgs:scaled=1,restarts=10
nlopt_lbfgs:scaled=1,restarts=10
tao_lmvm:scaled=1,restarts=10"

field() { # FILE KEY
  sed -n "s/^ *\"$2\": \"\{0,1\}\([^\"]*[^\",]\)\"\{0,1\},\{0,1\}$/\1/p" "$1" | head -n 1
}

mkdir -p "${folder}"
"${binaries}/jamming" --particles="${n}" --seed="${seed}" --nopictures \
  --out="${folder}/jammed" > "${folder}/jamming.log" 2>&1 || true
phi="$(field "${folder}/jammed/summary.json" phi_cr)"
for p in ${pressures}; do
  # p = 0.42 k (phi - phi_J) near jamming.
  factor="$(awk -v p="${p}" -v phi="${phi}" 'BEGIN { printf "%.17g", sqrt(1 + p / 0.42 / phi) }')"
  "${binaries}/relax" --input="${folder}/jammed/packing.xyz" --radius_factor="${factor}" \
    --tolerance=1e-12 --nopictures --out="${folder}/p${p}" > /dev/null 2>&1 || true
done
{
  printf '| method |'
  for p in ${pressures}; do printf ' p = %s |' "${p}"; done
  printf '\n| --- |'
  for p in ${pressures}; do printf ' --- |'; done
  printf '\n'
} | tee "${folder}/table.md"
: > "${folder}/words.txt"
for method in ${methods}; do
  printf '| `%s` |' "${method}" | tee -a "${folder}/table.md"
  for p in ${pressures}; do
    overlap="$(field "${folder}/p${p}/summary.json" mean_overlap)"
    "${binaries}/relax" --input="${folder}/p${p}/packing.xyz" --perturb="${overlap}" \
      --solver="${method}" --tolerance=1e-15 --zero_pressure=1e-30 --max_seconds=30 \
      --nopictures --out="${folder}/run" > /dev/null 2>&1 || true
    printf ' %.0e (%s) |' "$(field "${folder}/run/summary.json" quad_relative_residual)" \
      "$(field "${folder}/run/summary.json" iterations)" | tee -a "${folder}/table.md"
    printf '%s p=%s: %s\n' "${method}" "${p}" \
      "$(field "${folder}/run/summary.json" message)" >> "${folder}/words.txt"
  done
  printf '\n' | tee -a "${folder}/table.md"
done
echo "in brackets: iterations. The methods' last words are in ${folder}/words.txt"
