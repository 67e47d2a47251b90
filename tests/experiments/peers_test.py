#!/usr/bin/env python3
"""peers_test.py SOURCE_DIR BINARIES: experiments/peers as a user runs it.

Exit status: 0 all is well, 1 not, 77 there is no LAMMPS to test with.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE, BINARIES = sys.argv[1:3]
SCRIPT = os.path.join(SOURCE, "experiments/peers/lammps.py")
DATA = os.path.join(SOURCE, "tests/data/")
RELAXED = DATA + "n256_phi0.8438_a2_relaxed.xyz"


def run(*words):
    return subprocess.run(words, capture_output=True, text=True, check=False)


class Lammps(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp()

    def tearDown(self):
        shutil.rmtree(self.folder)

    def test_finds_the_state_that_relax_finds(self):
        loads = ["--radius_factor=1.00005"], ["--simple_shear=1e-4"], ["--perturb=1e-5", "--seed=3"]
        for load in loads:
            with self.subTest(load):
                out = self.folder + "/relax"
                ours = run(
                    BINARIES + "/relax",
                    "--input=" + RELAXED,
                    "--absolute_tolerance=1e-11",
                    "--nopictures",
                    "--out=" + out,
                    *load
                )
                self.assertEqual(ours.returncode, 0, ours.stderr)
                with open(out + "/summary.json", encoding="utf-8") as file:
                    expected = json.load(file)
                with open(out + "/trace.csv", encoding="utf-8") as file:
                    rows = [line.split(",") for line in file.read().splitlines()]
                    initial = dict(zip(rows[0], rows[1]))
                for style in "cg", "fire":
                    theirs = run(SCRIPT, RELAXED, "--style=" + style, "--tolerance_absolute=1e-11", *load)
                    self.assertEqual(theirs.returncode, 0, theirs.stderr)
                    result = json.loads(theirs.stdout.splitlines()[-1])
                    # The same packing, the same energy and forces ...
                    self.assertLess(result["energy_error"], 1e-12)
                    self.assertLess(result["force_error"], 1e-9)
                    cost = float(initial["energy"])
                    self.assertAlmostEqual(result["energy_initial"] / cost, 1.0, delta=1e-12)
                    # ... the same minimum.
                    self.assertAlmostEqual(result["energy"] / expected["energy"], 1.0, delta=1e-9)
                    self.assertLessEqual(result["true_max_force"], 1.001e-11)
                    self.assertGreater(result["evaluations"], result["iterations"])

    def test_keeps_its_files_and_the_packing(self):
        out = self.folder + "/out"
        self.assertEqual(run(SCRIPT, RELAXED, "--out=" + out).returncode, 0)
        for name in "in.relax", "packing.data", "pairs.table", "log.lammps", "packing.xyz":
            self.assertTrue(os.path.exists(out + "/" + name), name)
        judged = run(
            BINARIES + "/relax",
            "--input=" + out + "/packing.xyz",
            "--absolute_tolerance=1.001e-10",
            "--nopictures",
            "--out=" + self.folder + "/judged",
        )
        self.assertEqual(judged.returncode, 0, judged.stdout)
        self.assertIn("after 0 iterations", judged.stdout)

    def test_says_when_it_did_not_converge(self):
        result = run(SCRIPT, RELAXED, "--perturb=1e-4", "--max_iterations=3")
        self.assertEqual(result.returncode, 1)
        self.assertFalse(json.loads(result.stdout.splitlines()[-1])["converged"])

    def refuse(self, words, *arguments):
        result = run(SCRIPT, *arguments)
        self.assertEqual(result.returncode, 2, arguments)
        self.assertEqual(result.stderr.count("\n"), 1, result.stderr)
        self.assertIn(words, result.stderr)
        self.assertEqual(result.stdout, "")

    def test_refuses(self):
        self.refuse("which packing")
        self.refuse("No such file", self.folder + "/none.xyz")
        self.refuse("alpha = 2.5", DATA + "n256_phi0.8438_a2.5_relaxed.xyz")
        self.refuse("there is no no_lmp", RELAXED, "--lmp=no_lmp")
        self.refuse("--style", RELAXED, "--style=sd")
        self.refuse("--tolerance_absolute", RELAXED, "--tolerance_absolute=0")
        self.refuse("--perturb", RELAXED, "--perturb=nan")
        self.refuse("unrecognized", RELAXED, "--radius=2")
        self.refuse("--out=", RELAXED, "--out=/dev/null/x")
        self.refuse("too deep", RELAXED, "--radius_factor=1.3")
        with open(RELAXED, encoding="utf-8") as file:
            lines = file.read().splitlines()

        def altered(change):
            copy = list(lines)
            change(copy)
            with open(self.folder + "/altered.xyz", "w", encoding="utf-8") as file:
                file.write("\n".join(copy) + "\n")
            return self.folder + "/altered.xyz"

        def set_last(line, word):
            return lambda copy: copy.__setitem__(line, " ".join(copy[line].split()[:-1] + [word]))

        self.refuse("3 radii", altered(set_last(7, "0.03")))
        self.refuse("not finite or not positive", altered(set_last(7, "nan")))
        self.refuse("not finite or not positive", altered(set_last(7, "-1")))
        self.refuse("no extended XYZ", altered(set_last(7, "x")))
        self.refuse("no extended XYZ", altered(lambda copy: copy.pop()))
        self.refuse("no extended XYZ", altered(lambda copy: copy.__setitem__(1, "comment")))
        self.refuse("no extended XYZ", altered(lambda copy: copy.clear()))


if __name__ == "__main__":
    if shutil.which("lmp") is None:
        print("no lmp, nothing to test")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1])
