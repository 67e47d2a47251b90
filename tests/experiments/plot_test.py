"""plot.py: figures of a real run, the same bytes again, one line for what is wrong.

    plot_test.py SOURCE_DIR BINARIES
"""

import glob
import os
import re
import subprocess
import sys
import tempfile

SOURCE, BINARIES = sys.argv[1:3]
SCRIPT = os.path.join(SOURCE, "experiments", "plot.py")
# As the binaries do: Debian's matplotlib belongs to Debian's python.
PYTHON = next((name for name in ("/usr/bin/python3", sys.executable)
               if os.path.exists(name) and not subprocess.run(
                   [name, "-c", "import matplotlib"], capture_output=True,
                   check=False).returncode), None)


def Plot(*words):
  return subprocess.run([PYTHON, SCRIPT, *words], capture_output=True, text=True,
                        check=False)


def Bytes(base):
  return [open("%s.%s" % (base, kind), "rb").read() for kind in ("svg", "png")]


def main():
  if PYTHON is None:
    print("matplotlib is not installed")
    return 77
  help_ = Plot("--help")
  figures = re.findall(r"^    (\w+)", help_.stdout, re.M)
  assert len(figures) > 40, help_.stdout

  # Every figure is one that a binary or a script draws.
  callers = ""
  for name in glob.glob(SOURCE + "/experiments/*.cc") + glob.glob(SOURCE +
                                                                  "/experiments/*.sh"):
    callers += open(name, encoding="utf-8").read()
  unused = [name for name in figures if not re.search(r'["\s]%s["\s]' % name, callers)
            # flow.cc makes these names from their ends.
            and not re.search(r'"%s"' % name.partition("_")[2], callers)]
  assert not unused, unused

  with tempfile.TemporaryDirectory() as folder:
    os.chdir(folder)
    subprocess.run([BINARIES + "/relax", "--particles=64", "--phi=0.87", "--modes=1",
                    "--out=run"], check=True, stdout=subprocess.DEVNULL)
    calls = {"packing": ("run/packing.xyz", "run/contacts.csv"),
             "trace": ("run/trace.csv",),
             "mode": ("run/modes.xyz", "run/contacts.csv", "run/modes.csv")}
    for name, files in calls.items():
      again = Plot(name, *files, "again")
      assert again.returncode == 0, again.stderr
      assert Bytes("again") == Bytes("run/" + name), name

    # One line, status 2, nothing written.
    with open("run/trace.csv", encoding="utf-8") as file:
      head, first = file.read().splitlines()[:2]
    for name, text, said in (
        ("empty", "", "expected the columns"), ("bare", head + "\n", "no rows"),
        ("cut", head + "\n" + first.rpartition(",")[0] + "\n", ":2: "),
        ("word", head + "\nx" + first[1:] + "\n", "'x"),
        ("other", "a,b\n1,2\n", ":1: no column iteration")):
      with open(name + ".csv", "w", encoding="utf-8") as file:
        file.write(text)
      bad = Plot("trace", name + ".csv", "bad")
      assert bad.returncode == 2 and bad.stderr.count("\n") == 1, (name, bad)
      assert said in bad.stderr and name + ".csv" in bad.stderr, (name, bad.stderr)
    for words, said in ((("trace",), "TRACE.csv"), (("no_figure", "bad"), "no_figure"),
                        (("mode", *calls["mode"], "bad", "--number=9"), "no mode 9"),
                        (("trace", "absent.csv", "bad"), "absent.csv: No such file")):
      bad = Plot(*words)
      assert bad.returncode == 2 and bad.stderr.count("\n") == 1, (words, bad)
      assert said in bad.stderr, (words, bad.stderr)
    assert not glob.glob("bad*"), glob.glob("*")
  return 0


sys.exit(main())
