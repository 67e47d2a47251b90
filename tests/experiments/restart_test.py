"""Interrupts jamming and relaxations in every way and has them go on.

    restart_test.py BINARIES [KILLS]

SIGKILL at random moments (50 of them unless said otherwise), SIGINT, truncated
and damaged checkpoints: each time the run that goes on must end with the bytes
of the one that nothing happened to, and the checkpoint must be whole.
"""

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zlib

# With lbfgs there is time to be interrupted in.
FLAGS = ["--particles=96", "--nopictures", "--error_bar=1e-8", "--solver=lbfgs"]


def Command(seed, out, *more):
  return [BINARY, f"--seed={seed}", f"--out={out}", *FLAGS, *more]


def Run(*words):
  done = subprocess.run(Command(*words), capture_output=True, text=True)
  return done.returncode, done.stdout, done.stderr


def Results(out):
  """What must not depend on interruptions: all but times."""
  files = {}
  for name in ("packing.xyz", "contacts.csv", "stage_initial.xyz",
               "stage_unjammed.xyz"):
    with open(os.path.join(out, name), encoding="utf-8") as file:
      files[name] = file.read()
  with open(os.path.join(out, "path.csv"), encoding="utf-8") as file:
    files["path.csv"] = [line.rsplit(",", 1)[0] for line in file]
  with open(os.path.join(out, "summary.json"), encoding="utf-8") as file:
    text = file.read()
  files["phi_j"] = re.search(r'"phi_j": (\S+)', text).group(1)
  files["evaluations"] = re.search(r'"evaluations": (\d+)', text).group(1)
  return files


def CheckCheckpoint(path):
  with open(path, "rb") as file:
    header, body = file.read().split(b"\n", 1)
  words = header.split()
  assert words[:2] == [b"granopt-checkpoint", b"1"], header
  assert int(words[2]) == len(body), header
  assert int(words[3], 16) == zlib.crc32(body), header


def Damage(path, how):
  with open(path, "rb") as file:
    text = bytearray(file.read())
  if how == "cut short":
    text = text[:len(text) * 2 // 3]
  else:
    text[len(text) // 2] ^= 4
  with open(path, "wb") as file:
    file.write(text)


def Interrupt(command, out, generator, how):
  """Runs command, which checkpoints in out, and sends it the signal how.

  One run in four is interrupted whatever it does, within .3 s of its start; the
  others at a random moment after their next checkpoint. So however slow the machine
  is each of them gets further than the one before, and the test ends.
  Returns the exit status, what was printed, and whether the signal was sent.
  """
  path = os.path.join(out, "checkpoint.cbor")

  def Version():
    try:
      found = os.stat(path)
      return found.st_ino, found.st_mtime_ns
    except FileNotFoundError:
      return None

  before = Version()
  process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
  if generator.random() < 0.25:
    time.sleep(generator.uniform(0.0, 0.3))
  else:
    checkpoints = generator.randint(1, 4)
    while checkpoints and process.poll() is None:
      now = Version()
      if now != before:
        before = now
        checkpoints -= 1
      time.sleep(0.001)
    time.sleep(generator.uniform(0.0, 0.03))
  sent = process.poll() is None
  process.send_signal(how)
  text, _ = process.communicate()
  return process.returncode, text, sent


def RelaxIsTheSame(folder, generator):
  """A relaxation in legs, killed or asked to stop at random moments."""
  command = [os.path.join(sys.argv[1], "relax"), "--particles=512", "--seed=5",
             "--solver=lbfgs", "--tolerance=1e-9", "--leg=300", "--nopictures",
             "--nocertify"]
  names = ("packing.xyz", "contacts.csv", "trace.csv")

  def Files(out):
    files = {}
    for name in names:
      with open(f"{folder}/{out}/{name}", encoding="utf-8") as file:
        files[name] = [line.rsplit(",", 1)[0] if name == "trace.csv" else line
                       for line in file]
    return files

  done = subprocess.run(command + [f"--out={folder}/relax"],
                        capture_output=True, text=True)
  assert done.returncode == 0 and "leg " in done.stdout, done.stdout
  expected = Files("relax")
  resumed = 0
  for number in range(8):
    out = f"relax_{number}"
    more = []
    while True:
      how = generator.choice((signal.SIGKILL, signal.SIGINT))
      status, text, _ = Interrupt(command + [f"--out={folder}/{out}", *more],
                                  f"{folder}/{out}", generator, how)
      resumed += "resumed after evaluation" in text
      if status == 0:
        break
      assert status in (1, -how), text
      assert status != 1 or "stopped as asked" in text, text
      if os.path.exists(f"{folder}/{out}/checkpoint.cbor"):
        CheckCheckpoint(f"{folder}/{out}/checkpoint.cbor")
      more = ["--resume"]
    assert Files(out) == expected, out
  assert resumed > 0
  done = subprocess.run(
      command + [f"--out={folder}/relax", "--resume", "--alpha=2.5"],
      capture_output=True, text=True)
  assert done.returncode == 2 and "alpha = 2.0, now 2.5" in done.stderr
  print(f"relax: {resumed} runs that went on: the same bytes")


def main():
  kills = int(sys.argv[2]) if len(sys.argv) > 2 else 50
  generator = random.Random(5)
  folder = tempfile.mkdtemp(prefix="granopt_restart_")
  killed = seed = resumed = 0
  began = time.time()
  while killed < kills:
    seed += 1
    whole, broken = (f"{folder}/{name}_{seed}" for name in ("whole", "broken"))
    assert Run(seed, whole)[0] == 0
    last = 0
    more = []
    while True:
      status, out, sent = Interrupt(Command(seed, broken, *more), broken,
                                    generator, signal.SIGKILL)
      killed += sent
      assert status in (0, -signal.SIGKILL), out
      found = re.search(r"resumed after relaxation (\d+)", out)
      if found:
        resumed += 1
        assert int(found.group(1)) >= last, "a step was lost"
        last = int(found.group(1))
      path = os.path.join(broken, "checkpoint.cbor")
      if os.path.exists(path):
        CheckCheckpoint(path)
        more = ["--resume"]
      else:
        assert last == 0
      if status == 0:
        break
    assert Results(broken) == Results(whole), f"seed {seed}"
    left = [name for name in os.listdir(broken) if name.endswith(".tmp")]
    assert not left, left
  assert resumed > kills // 2
  print(f"{killed} kills, {resumed} runs that went on, {seed} packings, "
        f"{time.time() - began:.0f} s: every result has the same bytes")

  # Asked to stop, it ends its step and says how to go on.
  whole, broken = f"{folder}/whole_1", f"{folder}/stopped"
  assert Run(1, whole)[0] == 0
  stops = 0
  more = []
  while True:
    status, out, _ = Interrupt(Command(1, broken, *more), broken, generator,
                               signal.SIGINT)
    if status == 0:
      if stops >= 5:
        break
      more = []  # done before it was asked: once more
    elif status == 1:
      stops += 1
      assert "stopped as asked, after relaxation" in out, out
      assert not os.path.exists(broken + "/summary.json")
      more = ["--resume"]
    else:  # before it listened
      assert status == -signal.SIGINT, status
  assert Results(broken) == Results(whole)
  print(f"{stops} stops by SIGINT: the same bytes")

  # Damaged files are named, and the older one is used. A packing large enough not
  # to be done before it is stopped.
  slow = "--particles=400"
  whole = f"{folder}/whole_slow"
  assert Run(1, whole, slow)[0] == 0
  for how in ("cut short", "damaged"):
    out = f"{folder}/faulty_{len(how)}"
    newest, older = out + "/checkpoint.cbor", out + "/checkpoint.cbor.previous"

    # For a moment of each writing both names are those of one file.
    def TwoCheckpoints():
      try:
        return not os.path.samefile(newest, older)
      except FileNotFoundError:
        return False

    while not TwoCheckpoints():
      shutil.rmtree(out, ignore_errors=True)
      process = subprocess.Popen(Command(1, out, slow), stdout=subprocess.PIPE,
                                 text=True)
      while process.poll() is None and not TwoCheckpoints():
        time.sleep(0.001)
      assert process.poll() is None, "done before it was interrupted"
      process.send_signal(signal.SIGKILL)
      process.communicate()
    Damage(out + "/checkpoint.cbor", how)
    shutil.copytree(out, out + "_both")
    status, text, error = Run(1, out, slow, "--resume")
    assert status == 0, text + error
    assert re.search(rf"checkpoint.cbor: {how}.*: the one before is used",
                     text), text
    assert Results(out) == Results(whole)
    Damage(out + "_both/checkpoint.cbor.previous", how)
    before = sorted(os.listdir(out + "_both"))
    status, text, error = Run(1, out + "_both", slow, "--resume")
    assert status == 2 and error.count("\n") == 1, error
    assert error.count(how) == 2 and "nothing to go on from" in error, error
    assert sorted(os.listdir(out + "_both")) == before
  print("cut and damaged checkpoints: named, the one before used, the same "
        "bytes")
  RelaxIsTheSame(folder, generator)
  # Other flags are refused.
  status, _, error = Run(1, whole, slow, "--resume", "--dphi=2e-3")
  assert status == 2 and "dphi = 0.001, now 0.002" in error, error
  shutil.rmtree(folder)
  return 0


if __name__ == "__main__":
  BINARY = os.path.join(sys.argv[1], "jamming")
  sys.exit(main())
