#!/usr/bin/env python3
"""lp_jamming_test.py SOURCE_DIR BINARIES: a chain of linear programs finds the
jamming point that `jamming` found.

Exit status: 0 all is well, 1 not, 77 there is no SciPy to test with.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE, BINARIES = sys.argv[1:3]
SCRIPT = os.path.join(SOURCE, "experiments/lp_jamming.py")
DATA = os.path.join(SOURCE, "tests/data/")
PYTHON = "/usr/bin/python3" if os.path.exists("/usr/bin/python3") else sys.executable


def run(*words):
    return subprocess.run(words, capture_output=True, text=True, check=False)


def solve(*words):
    result = run(PYTHON, SCRIPT, *words)
    return result, json.loads(result.stdout.splitlines()[-1]) if result.stdout else None


class LinearPrograms(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp()

    def tearDown(self):
        shutil.rmtree(self.folder)

    def jam(self, *words):
        made = run(
            BINARIES + "/jamming",
            "--smoke",
            "--error_bar=1e-8",
            "--solver=interior_point|newton|lbfgs",
            "--nopictures",
            "--out=" + self.folder,
            *words
        )
        self.assertEqual(made.returncode, 0, made.stderr)

    def test_finds_the_jamming_point(self):
        self.jam("--seed=2")
        # However the grains are displaced before.
        for shake in "0", "1e-6", "1e-4":
            result, report = solve(self.folder + "/packing.xyz", "--shake=" + shake)
            self.assertEqual(result.returncode, 0, result.stderr)
            self.assertLess(abs(report["difference"]), 1e-12)
            self.assertEqual(report["active"], report["isostatic"])
            self.assertEqual(report["isostatic"], 2 * report["rigid_grains"] - 1)
            # The packing is 1e-8 above its jamming point, where forces differ.
            self.assertLess(report["force_difference"], 1e-3)

    def test_spheres(self):
        self.jam("--seed=3", "--dimension=3")
        result, report = solve(self.folder + "/packing.xyz")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertLess(abs(report["difference"]), 1e-12)
        self.assertEqual(report["active"], 3 * report["rigid_grains"] - 2)
        self.assertEqual(report["isostatic"], report["active"])

    def test_takes_phi_j_from_elsewhere(self):
        result, report = solve(DATA + "n64_jammed.xyz", "--phi_j=0.8344466513")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertLess(abs(report["difference"]), 1e-10)
        self.assertNotIn("force_difference", report)
        # Twice the unit of length, the same answer.
        with open(DATA + "n64_jammed.xyz", encoding="utf-8") as file:
            lines = file.read().splitlines()
        head = lines[1].split('"')
        head[1] = " ".join("%.17g" % (2 * float(word)) for word in head[1].split())
        scaled = [lines[0], '"'.join(head)]
        for line in lines[2:]:
            words = line.split()
            scaled.append(" ".join(words[:1] + ["%.17g" % (2 * float(word)) for word in words[1:]]))
        with open(self.folder + "/twice.xyz", "w", encoding="utf-8") as file:
            file.write("\n".join(scaled) + "\n")
        twice = solve(self.folder + "/twice.xyz")[1]
        self.assertEqual(twice["phi_j"], report["phi_j"])

    def refuse(self, words, *arguments):
        result = run(PYTHON, SCRIPT, *arguments)
        self.assertEqual(result.returncode, 2, arguments)
        self.assertEqual(result.stderr.count("\n"), 1, result.stderr)
        self.assertIn(words, result.stderr)
        self.assertEqual(result.stdout, "")

    def test_refuses(self):
        jammed = DATA + "n64_jammed.xyz"
        self.refuse("required: packing")
        self.refuse("cannot read", self.folder + "/none.xyz")
        self.refuse("--shake=0.5", jammed, "--shake=0.5")
        self.refuse("--bound=0 ", jammed, "--bound=0")
        self.refuse("--programs=0", jammed, "--programs=0")
        self.refuse("--seed=-1", jammed, "--seed=-1")
        self.refuse("invalid float", jammed, "--phi_j=x")
        self.refuse("no file of contacts", jammed, "--contacts=" + jammed)
        with open(self.folder + "/short.xyz", "w", encoding="utf-8") as file:
            file.write("3\nLattice")
        self.refuse("no extended XYZ", self.folder + "/short.xyz")


if __name__ == "__main__":
    if run(PYTHON, "-c", "import scipy").returncode != 0:
        print("no SciPy, nothing to test")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1])
