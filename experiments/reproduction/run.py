"""Runs the studies and writes the page; see ../reproduce.sh."""

import argparse
import datetime
import json
import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field

import page
import studies

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


def Fail(message):
  sys.stderr.write("reproduce.sh: %s\n" % message)
  sys.exit(2)


@dataclass
class Result:
  """A study on the page."""
  study: studies.Study
  folder: str
  shown_command: str
  status: int = 0
  failure: str = ""
  last_lines: str = ""
  origin: str = ""
  claims: list = field(default_factory=list)
  tables: list = field(default_factory=list)


class Run:
  """One study: its process, and the record of it beside its folder."""

  def __init__(self, study, options):
    self.study = study
    base = os.path.join(options.out, "smoke" if options.smoke else "full")
    self.folder = os.path.join(base, study.key)
    self.log = os.path.join(base, study.key + ".log")
    self.record_path = os.path.join(base, study.key + ".json")
    self.words = study.command + (study.smoke if options.smoke else [])
    self.binaries = options.binaries
    self.process = None
    self.record = self.Read()

  def Read(self):
    try:
      with open(self.record_path, encoding="utf-8") as file:
        record = json.load(file)
    except (OSError, ValueError):
      return {}
    return record if record.get("command") == self.words else {}

  def IsDone(self):
    return self.record.get("status") in (0, 1)

  def Start(self):
    words = [os.path.join(self.binaries, self.words[0])] + self.words[1:]
    words.append("--out=" + self.folder)
    # An earlier try with the same command.
    if self.record and self.study.resumes:
      words.append("--resume")
    elif os.path.isdir(self.folder):
      shutil.rmtree(self.folder)
    os.makedirs(os.path.dirname(self.folder), exist_ok=True)
    if not self.record:
      self.record = {"command": self.words, "seconds": 0.0, "cpu_seconds": 0.0}
    self.record.pop("status", None)
    self.Write()
    self.began = time.time()
    with open(self.log, "w", encoding="utf-8") as log:
      # A session of its own: Ctrl-C comes once, from here.
      self.process = subprocess.Popen(words, stdout=log, stderr=subprocess.STDOUT,
                                      stdin=subprocess.DEVNULL,
                                      start_new_session=True)

  def Ended(self):
    """True if it has ended, which is then written down."""
    pid, status, usage = os.wait4(self.process.pid, os.WNOHANG)
    if pid == 0:
      return False
    self.process.returncode = os.waitstatus_to_exitcode(status)
    self.record["seconds"] += time.time() - self.began
    self.record["cpu_seconds"] += usage.ru_utime + usage.ru_stime
    self.record["status"] = self.process.returncode
    self.record["date"] = datetime.date.today().isoformat()
    # Stopped before its results were there: that goes on another time.
    if not os.path.exists(os.path.join(self.folder, "summary.json")):
      if self.process.returncode in (0, 1):
        self.record["status"] = "stopped"
    self.Write()
    return True

  def Write(self):
    WriteAtomically(self.record_path, json.dumps(self.record))

  def Result(self):
    shown = "build/release/experiments/" + shlex.join(self.words)
    result = Result(self.study, self.folder, shown)
    status = self.record.get("status")
    if not self.IsDone():
      what = {None: "it was not run", "stopped": "it was stopped"}.get(
          status, "it ended with status %s" % status)
      result.failure = "No results: %s. The same command goes on." % what
      result.last_lines = LastLines(self.log)
      return result
    result.status = status
    try:
      provenance = studies.Summary(self.folder)["provenance"]
      result.claims, result.tables = self.study.read(self.folder)
      result.origin = "%s, %s of CPU time, %s, revision %s; files in %s" % (
          self.record["date"], page.Duration(self.record["cpu_seconds"]),
          provenance["cpu"], provenance["granopt"],
          os.path.relpath(self.folder, ROOT))
    except (OSError, ValueError, KeyError, IndexError, TypeError, StopIteration,
            ZeroDivisionError) as error:
      result.failure = "Its results could not be read: %s: %s" % (
          type(error).__name__, error)
    return result


def WriteAtomically(path, text):
  with open(path + ".tmp", "w", encoding="utf-8") as file:
    file.write(text)
  os.replace(path + ".tmp", path)


def LastLines(path, count=8):
  try:
    with open(path, encoding="utf-8", errors="replace") as file:
      return "".join(file.readlines()[-count:])
  except OSError:
    return ""


def Size(folder):
  return sum(os.path.getsize(os.path.join(where, name))
             for where, _, names in os.walk(folder) for name in names)


def Processor():
  try:
    with open("/proc/cpuinfo", encoding="utf-8") as file:
      for line in file:
        if line.startswith("model name"):
          return line.split(":", 1)[1].strip()
  except OSError:
    pass
  return platform.processor() or platform.machine()


def ReadOptions():
  parser = argparse.ArgumentParser(
      prog="reproduce.sh", description="Runs every study and writes OUT/index.html.")
  parser.add_argument("--smoke", action="store_true",
                      help="systems of seconds, to see that everything works")
  parser.add_argument("--jobs", type=int, default=1, help="studies at a time")
  parser.add_argument("--out", default=os.path.join(ROOT, "report"),
                      help="folder of the page and of all results")
  parser.add_argument("--only", default="", help="studies, as in fig8,flow")
  parser.add_argument("--list", action="store_true", help="print the studies")
  parser.add_argument("--page", action="store_true",
                      help="run nothing, write the page of what is there")
  parser.add_argument("--binaries",
                      default=os.path.join(ROOT, "build", "release", "experiments"),
                      help=argparse.SUPPRESS)
  parser.error = lambda message: Fail(message + " (--help lists them)")
  options = parser.parse_args()
  if not 1 <= options.jobs <= 1024:
    Fail("--jobs=%d must be in [1, 1024]" % options.jobs)
  options.out = os.path.abspath(options.out)
  keys = [study.key for study in studies.STUDIES]
  chosen = options.only.split(",") if options.only else keys
  for key in chosen:
    if key not in keys:
      Fail("--only=%s: no study of that name (--list)" % key)
  options.chosen = [study for study in studies.STUDIES if study.key in chosen]
  if options.list:
    for study in options.chosen:
      print("%-16s %-34s %s" % (study.key, study.source, " ".join(study.command)))
    sys.exit(0)
  for study in options.chosen:
    if not options.page and not os.path.exists(
        os.path.join(options.binaries, study.command[0])):
      Fail("%s is not built" % os.path.join(options.binaries, study.command[0]))
  return options


def RunAll(runs, jobs):
  """Runs them, the long ones first; returns True if asked to stop."""
  stop = []
  for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, lambda *_: stop.append(True))
  waiting = sorted((run for run in runs if not run.IsDone()),
                   key=lambda run: -run.study.minutes)
  total, ended, asked = len(waiting), 0, False
  running = []
  if total < len(runs):
    print("%d of %d studies were done before" % (len(runs) - total, len(runs)))
  while running or (waiting and not stop):
    while waiting and len(running) < jobs and not stop:
      run = waiting.pop(0)
      run.Start()
      running.append(run)
      print("  started   %-16s %s" % (run.study.key, run.study.title), flush=True)
    if stop and not asked:
      asked = True
      for run in running:
        os.kill(run.process.pid, signal.SIGINT)
    for run in list(running):
      if not run.Ended():
        continue
      running.remove(run)
      ended += 1
      status = run.record["status"]
      word = {0: "done", 1: "done, not all of it converged",
              "stopped": "stopped"}.get(status, "FAILED with status %s" % status)
      print("  %3d of %d  %-16s %s, %s" % (
          ended, total, run.study.key, word,
          page.Duration(time.time() - run.began)), flush=True)
      if status not in (0, 1, "stopped"):
        sys.stderr.write("".join("      " + line for line in
                                 LastLines(run.log, 3).splitlines(True)))
    time.sleep(0.1)
  return bool(stop)


def main():
  options = ReadOptions()
  runs = [Run(study, options) for study in options.chosen]
  began = time.time()
  stopped = False
  if not options.page:
    stopped = RunAll(runs, options.jobs)
  results = [run.Result() for run in runs]
  os.makedirs(options.out, exist_ok=True)
  cpu = sum(run.record.get("cpu_seconds", 0.0) for run in runs)
  facts = [("date", datetime.date.today().isoformat()), ("processor", Processor()),
           ("CPU time of all studies", page.Duration(cpu)),
           ("disk", "%.0f MB" % (sum(Size(run.folder) for run in runs) / 1e6))]
  target = os.path.join(options.out, "index.html")
  WriteAtomically(target, page.Page(results, options.smoke, facts))
  failed = [result for result in results if result.failure]
  judged = [claim for result in results for claim in result.claims
            if claim.agrees is not None]
  if not options.smoke:
    print("%d of %d claims agree; the page says why the others differ"
          % (sum(claim.agrees for claim in judged), len(judged)))
  waiting = [run.study.key for run in runs if "status" not in run.record]
  for result in failed:
    if result.study.key not in waiting:
      print("%-16s %s" % (result.study.key, result.failure))
  if waiting:
    print("not run yet: " + ", ".join(waiting))
  if stopped:
    print("stopped as asked: the same command goes on")
  print("%s (%s; %.1f MB, opens without a network)"
        % (os.path.relpath(target), page.Duration(time.time() - began),
           os.path.getsize(target) / 1e6))
  return 1 if failed or stopped else 0


if __name__ == "__main__":
  sys.exit(main())
