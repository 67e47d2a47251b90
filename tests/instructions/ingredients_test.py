"""An ingredient that a scene does not contain costs nothing: instructions of a step
of a flow of impacts alone, in the library with every ingredient compiled in and in a
build without them, agree within 1 %, and so do the bits of the results.

    ingredients_test.py RUN_FLOW RUN_FLOW_CONTACTS_ONLY
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile

STEPS = 300


def Count(program, steps):
  with tempfile.TemporaryDirectory() as folder:
    run = subprocess.run(
        ["valgrind", "--tool=callgrind", "--log-file=" + folder + "/log",
         "--callgrind-out-file=" + folder + "/out", program, str(steps)],
        stdout=subprocess.PIPE, text=True, check=True,
        env=dict(os.environ, LD_BIND_NOW="1"))
    with open(folder + "/out") as file:
      total = re.search(r"^(?:summary|totals): (\d+)", file.read(), re.M)
  return int(total.group(1)), run.stdout.strip()


def main():
  if shutil.which("valgrind") is None:
    print("no valgrind (apt install valgrind)")
    return 77
  counts, results = [], []
  for program, name in zip(sys.argv[1:3], ("whole", "contacts only")):
    none, _ = Count(program, 0)
    some, result = Count(program, STEPS)
    assert result.startswith(name + " "), result
    counts.append((some - none) / STEPS)
    results.append(result[len(name):])
    print(f"{name}: {counts[-1]:.1f} instructions a step")
  assert results[0] == results[1], results
  assert int(results[0].split()[1]) > 100, results
  ratio = counts[0] / counts[1]
  print(f"whole / contacts only: {ratio:.4f}")
  return 0 if abs(ratio - 1.0) <= 0.01 else 1


if __name__ == "__main__":
  sys.exit(main())
