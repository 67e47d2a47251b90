#!/bin/bash
# What a grain costs as packings grow: nanoseconds of an iteration and bytes, from
# 1024 to 1000000 discs at phi = 0.8438, alpha = 2. Each is taken from a random
# start (EARLY evaluations, in which lists of neighbours are made every few) and then
# timed over LATE more. Writes FOLDER/scaling.csv and scaling.svg; ten minutes.
#
#   experiments/scaling.sh [FOLDER=out/scaling [MOST=1000000]]
set -euo pipefail
cd "$(dirname -- "${BASH_SOURCE[0]}")/.."
folder="${1:-out/scaling}"
most="${2:-1000000}"
relax=build/release/experiments/relax

field() { # FILE KEY
  sed -n "s/^ *\"$2\": \([^\",]*\),\{0,1\}$/\1/p" "$1" | head -n 1
}

mkdir -p "${folder}"
csv="particles,method,evaluations,seconds,energy_seconds,list_builds,peak_bytes"
for n in 1024 4096 16384 65536 262144 1000000; do
  [ "${n}" -le "${most}" ] || continue
  for method in fire lbfgs; do
    early=800
    late=$((40000000 / n < 100 ? 100 : 40000000 / n))
    flags=(--nopictures --nocertify --solver="${method}" --tolerance=1e-14)
    start="${folder}/start_${n}"
    if [ "${method}" = fire ]; then
      "${relax}" "${flags[@]}" --particles="${n}" --phi=0.8438 \
        --max_evaluations="${early}" --out="${start}" > "${folder}/log" || [ $? -eq 1 ]
    fi
    run="${folder}/${method}_${n}"
    "${relax}" "${flags[@]}" --input="${start}/packing.xyz" \
      --max_evaluations="${late}" --out="${run}" > "${folder}/log" || [ $? -eq 1 ]
    summary="${run}/summary.json"
    row="${n},${method}"
    for key in evaluations seconds function_seconds list_builds peak_bytes; do
      row="${row},$(field "${summary}" "${key}")"
    done
    csv="${csv}
${row}"
    echo "${row}"
  done
  rm -rf "${folder}/start_${n}"
done
echo "${csv}" > "${folder}/scaling.csv"
python3 experiments/plot.py scaling "${folder}/scaling.csv" "${folder}/scaling"
