"""Instructions per grain of each kernel against those on record.

    instructions_test.py RUN_KERNEL PACKING RECORD COMPILER [--update]

Counts under valgrind do not depend on what else the machine does. They do on
compiler and instruction set, so a record of others is not compared (exit 77,
as where there is no valgrind). More than 3 % above is a failure; as much below
is one, too, until --update has put the better numbers on record.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile

TOLERANCE = 0.03
KERNELS = {"energy": 20, "hessian": 10, "list": 5, "rebase": 5, "analyze": 2,
           "factorize": 3, "solve": 10, "fire": 1, "lbfgs": 1}


def Count(program, packing, kernel, times):
  with tempfile.TemporaryDirectory() as folder:
    run = subprocess.run(
        ["valgrind", "--tool=callgrind", "--log-file=" + folder + "/log",
         "--callgrind-out-file=" + folder + "/out", program, packing, kernel,
         str(times)], stdout=subprocess.PIPE, text=True, check=True,
        env=dict(os.environ, LD_BIND_NOW="1"))
    with open(folder + "/out") as file:
      total = re.search(r"^(?:summary|totals): (\d+)", file.read(), re.M)
  return int(total.group(1)), run.stdout.strip()


def main():
  program, packing, record, compiler = sys.argv[1:5]
  if shutil.which("valgrind") is None:
    print("no valgrind (apt install valgrind)")
    return 77
  with open(packing) as file:
    grains = int(file.readline())
  none, machine = Count(program, packing, "energy", 0)
  setup = f"{compiler}, {machine}"
  update = "--update" in sys.argv
  if not update:
    with open(record) as file:
      on_record = json.load(file)
    if on_record["setup"] != setup:
      print(f"on record: {on_record['setup']}; here: {setup}: not compared")
      return 77
    before = on_record["instructions_per_grain"]
    assert before.keys() == KERNELS.keys(), "--update: other kernels"
  now = {}
  for kernel, times in KERNELS.items():
    some, _ = Count(program, packing, kernel, times)
    now[kernel] = round((some - none) / times / grains, 1)
  if update:
    with open(record, "w") as file:
      json.dump({"setup": setup, "instructions_per_grain": now}, file, indent=2)
      file.write("\n")
    return 0
  status = 0
  print("kernel     on record       now   change")
  for kernel, count in now.items():
    old = before[kernel]
    change = count / old - 1
    verdict = ""
    if abs(change) > TOLERANCE:
      status = 1
      verdict = "  more work than before" if change > 0 else (
          "  less: put it on record (--update)")
    print(f"{kernel:9s}  {old:9.1f} {count:9.1f}  {100 * change:+6.1f} %{verdict}")
  return status


if __name__ == "__main__":
  sys.exit(main())
