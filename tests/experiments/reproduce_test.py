"""The reproduction: its page, its verdicts, and that it goes on after faults.

    reproduce_test.py SOURCE_DIR BINARIES
"""

import html.parser
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time

SOURCE, BINARIES = sys.argv[1:3]
sys.path.insert(0, os.path.join(SOURCE, "experiments", "reproduction"))

import page  # pylint: disable=wrong-import-position
import studies  # pylint: disable=wrong-import-position

QUICK = "fig8,yield,oscillator,powder"


class Checker(html.parser.HTMLParser):
  """Every element is closed, and nothing comes from elsewhere."""

  def __init__(self):
    super().__init__()
    self.open, self.ids, self.links, self.images = [], set(), set(), 0

  def handle_starttag(self, tag, attributes):
    attributes = dict(attributes)
    if "id" in attributes:
      assert attributes["id"] not in self.ids, attributes
      self.ids.add(attributes["id"])
    if tag == "a":
      self.links.add(attributes["href"])
    if tag == "img":
      self.images += 1
      assert attributes["src"].startswith("data:image/"), attributes["src"][:80]
      assert attributes["alt"]
    if tag not in ("meta", "img", "link"):
      self.open.append(tag)

  def handle_endtag(self, tag):
    assert self.open.pop() == tag, tag


def Check(path):
  with open(path, encoding="utf-8") as file:
    text = file.read()
  checker = Checker()
  checker.feed(text)
  assert not checker.open, checker.open
  assert checker.links <= {"#" + name for name in checker.ids}
  assert not re.search(r"(src|href)=.https?:|@import|url\(", text)
  return text, checker


def Command(out, *more, binaries=BINARIES):
  return [sys.executable, os.path.join(SOURCE, "experiments", "reproduction", "run.py"),
          "--smoke", "--out=" + out, "--binaries=" + binaries, *more]


def Run(*words, **more):
  return subprocess.run(Command(*words, **more), capture_output=True, text=True,
                        check=False)


def main():
  folder = tempfile.mkdtemp(prefix="granopt_reproduce_")
  out = folder + "/report"

  # The verdicts.
  agrees = studies.Claim("a", "1", "1", True)
  differs = studies.Claim("a", "1", "2", False, "x < y")
  assert "agrees" in page.Verdict(agrees, False)
  assert "because x &lt; y" in page.Verdict(differs, False)
  assert "open why" in page.Verdict(studies.Claim("a", "1", "2", False), False)
  assert "not judged" in page.Verdict(differs, True)
  assert studies.Number("1234567", 3) == "1.23e+06"
  assert studies.Number(143.2, 2) == "143" and studies.Number(0.0) == "0"
  assert studies.WithError(0.50312, 0.0271) == "0.503 ± 0.027"
  keys = [study.key for study in studies.STUDIES]
  assert len(set(keys)) == len(keys)

  # Some studies, at a size of seconds.
  run = Run(out, "--only=" + QUICK, "--jobs=2")
  assert run.returncode == 0, run.stdout + run.stderr
  text, checker = Check(out + "/index.html")
  assert "not judged at this size" in text
  for key in QUICK.split(","):
    assert key in checker.ids, key
    assert os.path.exists(f"{out}/smoke/{key}/summary.json")
  has_pictures = os.path.exists(out + "/smoke/fig8/curves.svg")
  assert checker.images >= (4 if has_pictures else 0), checker.images

  # What is done is not done again.
  before = os.stat(out + "/smoke/fig8/summary.json").st_mtime_ns
  run = Run(out, "--only=" + QUICK)
  assert run.returncode == 0 and "4 of 4 studies were done before" in run.stdout
  assert os.stat(out + "/smoke/fig8/summary.json").st_mtime_ns == before

  # A study that fails stops none of the others, and the page says so.
  fake = folder + "/binaries"
  os.mkdir(fake)
  for name in os.listdir(BINARIES):
    if os.access(os.path.join(BINARIES, name), os.X_OK):
      os.symlink(os.path.join(BINARIES, name), os.path.join(fake, name))
  os.unlink(fake + "/flow")
  with open(fake + "/flow", "w", encoding="utf-8") as file:
    file.write("#!/bin/sh\necho 'flow: no such thing <b>' >&2\nexit 2\n")
  os.chmod(fake + "/flow", 0o755)
  shutil.rmtree(out)
  run = Run(out, "--only=oscillator,powder", binaries=fake)
  assert run.returncode == 1, run.stdout + run.stderr
  assert "FAILED with status 2" in run.stdout and "no such thing" in run.stderr
  text, checker = Check(out + "/index.html")
  assert "ended with status 2" in text and "no such thing &lt;b&gt;" in text
  run = Run(out, "--only=oscillator,powder")
  assert run.returncode == 0 and "1 of 2 studies were done" in run.stdout, run.stdout

  # Asked to stop, it ends its studies and goes on another time.
  os.unlink(fake + "/shear")
  with open(fake + "/shear", "w", encoding="utf-8") as file:
    file.write("#!/bin/sh\ntrap 'exit 1' INT\ntouch %s/began\n"
               "while :; do sleep 0.05; done\n" % folder)
  os.chmod(fake + "/shear", 0o755)
  process = subprocess.Popen(Command(out, "--only=fig8,powder", binaries=fake),
                             stdout=subprocess.PIPE, text=True)
  while not os.path.exists(folder + "/began"):
    time.sleep(0.01)
  process.send_signal(signal.SIGINT)
  said, _ = process.communicate(timeout=60)
  assert process.returncode == 1 and "goes on" in said, said
  with open(out + "/smoke/fig8.json", encoding="utf-8") as file:
    assert json.load(file)["status"] == "stopped"
  run = Run(out, "--only=fig8,powder")
  assert run.returncode == 0, run.stdout + run.stderr

  # Bad input.
  for words, said in ((["--jobs=0"], "--jobs=0"), (["--only=fig9"], "fig9"),
                      (["--nonsense"], "--nonsense")):
    run = Run(folder + "/none", *words)
    assert run.returncode == 2 and run.stderr.count("\n") == 1, run.stderr
    assert said in run.stderr, run.stderr
  assert not os.path.exists(folder + "/none")
  shutil.rmtree(folder)
  print("the page, its verdicts, faults and stops")
  return 0


if __name__ == "__main__":
  sys.exit(main())
