"""Runs the commands that --help and the README show; knows the flags of all others.

    commands_test.py SOURCE_DIR BINARIES
"""

import glob
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time

SOURCE, BINARIES = sys.argv[1:3]
PREFIX = "build/release/experiments/"
NAMES = ("relax", "jamming", "compare", "conditioning", "scaling", "shear", "tradeoff",
         "extremes", "fidelity", "flow", "identify")


def Help(name):
  return subprocess.run([os.path.join(BINARIES, name), "--help"], capture_output=True,
                        text=True, check=True).stdout


def Documented(path):
  """Commands in the indented blocks of a page: lists of words."""
  commands = []
  with open(path, encoding="utf-8") as file:
    text = re.sub(r"\\\n\s*", " ", file.read())
  for line in text.splitlines():
    if not line.startswith("    " + PREFIX):
      continue
    words = shlex.split(line, comments=True)
    if "..." not in line and words[0][len(PREFIX):] in NAMES:
      commands.append(words)
  return commands


def main():
  helps = {name: Help(name) for name in NAMES}
  flags = {name: set(re.findall(r"^  --(\w+)", text, re.M))
           for name, text in helps.items()}
  pages = [os.path.join(SOURCE, "README.md")]
  pages += sorted(glob.glob(os.path.join(SOURCE, "experiments", "*.md")))
  count = 0
  for page in pages:
    for words in Documented(page):
      name = words[0][len(PREFIX):]
      for word in words[1:]:
        flag = re.match(r"--(?:no)?(\w+)", word)
        assert flag, (page, words)
        known = flags[name] | {"no" + f for f in flags[name]}
        assert re.match(r"--(\w+)", word).group(1) in known, (page, word, words)
      count += 1
  print(f"{count} commands on {len(pages)} pages: every flag is there")

  folder = tempfile.mkdtemp(prefix="granopt_commands_")
  shutil.copy(os.path.join(SOURCE, "tests", "data", "n256_phi0.8438_a2_relaxed.xyz"),
              os.path.join(folder, "packing.xyz"))
  shutil.copy(os.path.join(SOURCE, "tests", "data", "signal.csv"), folder)
  commands = Documented(pages[0])
  for name in NAMES:
    examples = helps[name].split("\nExamples\n")[1].split("\n\n")[0]
    commands += [shlex.split(line) for line in examples.splitlines()]
  done = set()
  for words in commands:
    words = [words[0].replace(PREFIX, "")] + words[1:]
    if tuple(words) in done:
      continue
    done.add(tuple(words))
    began = time.time()
    run = subprocess.run([os.path.join(BINARIES, words[0]), "--nopictures", *words[1:]],
                         cwd=folder, capture_output=True, text=True, check=False)
    print(f"{time.time() - began:6.1f} s  {shlex.join(words)}", flush=True)
    assert run.returncode == 0, f"status {run.returncode}: {run.stdout}{run.stderr}"
  shutil.rmtree(folder)
  print(f"{len(done)} commands of the README and of --help: they run")
  return 0


if __name__ == "__main__":
  sys.exit(main())
