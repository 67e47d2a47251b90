#!/bin/bash
# What a grain costs as packings grow: nanoseconds of an iteration and bytes, from
# 1024 to 1000000 discs at phi = 0.8438, alpha = 2. Each is taken from a random
# start (EARLY evaluations, in which lists of neighbours are made every few) and then
# timed over LATE more, with one thread and with THREADS. Seconds are those of the
# clock. Writes FOLDER/grain_cost.csv and grain_cost.svg; four minutes.
#
#   experiments/grain_cost.sh [FOLDER=out/grain_cost [MOST=1000000 [THREADS=2]]]
set -euo pipefail
cd "$(dirname -- "${BASH_SOURCE[0]}")/.."
folder="${1:-out/grain_cost}"
most="${2:-1000000}"
threads="${3:-2}"
relax=build/release/experiments/relax

field() { # FILE KEY
  sed -n "s/^ *\"$2\": \([^\",]*\),\{0,1\}$/\1/p" "$1" | head -n 1
}

mkdir -p "${folder}"
csv="particles,method,threads,evaluations,seconds,energy_seconds,list_builds,peak_bytes"
for n in 1024 4096 16384 65536 262144 1000000; do
  [ "${n}" -le "${most}" ] || continue
  early=800
  late=$((40000000 / n < 100 ? 100 : 40000000 / n))
  flags=(--nopictures --nocertify --tolerance=1e-14)
  start="${folder}/start_${n}"
  "${relax}" "${flags[@]}" --particles="${n}" --phi=0.8438 --solver=fire \
    --threads="${threads}" --max_evaluations="${early}" --out="${start}" \
    > "${folder}/log" || [ $? -eq 1 ]
  for method in fire lbfgs; do
    for t in $(printf "%s\n" 1 "${threads}" | sort -nu); do
      # Fewer grains are not shared out.
      [ "${t}" = 1 ] || [ "${n}" -gt 4096 ] || continue
      run="${folder}/${method}_${n}_${t}"
      "${relax}" "${flags[@]}" --input="${start}/packing.xyz" --solver="${method}" \
        --threads="${t}" --max_evaluations="${late}" --out="${run}" \
        > "${folder}/log" || [ $? -eq 1 ]
      summary="${run}/summary.json"
      row="${n},${method},${t}"
      for key in evaluations seconds function_seconds list_builds peak_bytes; do
        row="${row},$(field "${summary}" "${key}")"
      done
      csv="${csv}
${row}"
      echo "${row}"
    done
  done
  rm -rf "${folder}/start_${n}"
done
echo "${csv}" > "${folder}/grain_cost.csv"
/usr/bin/python3 experiments/plot.py grain_cost "${folder}/grain_cost.csv" "${folder}/grain_cost"
