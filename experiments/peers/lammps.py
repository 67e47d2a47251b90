#!/usr/bin/env python3
"""Relaxes a packing of discs with LAMMPS, as a peer to compare with.

  lammps.py PACKING.xyz --style=cg|fire [--tolerance_absolute=1e-10]
            [--radius_factor=1 --simple_shear=0 --perturb=0 --seed=1]
            [--out=DIR] [--lmp=lmp] [--timestep=0.05] [--points=4096]
            [--table=spline|linear] [--max_iterations=1000000]

The loads are those of experiments/relax, with the same random numbers. The
contact energy k delta^2 / 2 is no pair style of LAMMPS; each pair of radii gets
a table, whose file is exact (cubic splines through a parabola and a straight
line), and which LAMMPS resamples at --points distances even in r^2. What that
costs is measured: "energy_error" and "force_error" compare LAMMPS' energy and
forces at the start with sums over the same contacts done here.

Prints a line for people and one of JSON, the last of stdout. With --out=DIR the
input, tables, log and the relaxed packing (packing.xyz) stay there.

Exit status: 0 done, 1 did not converge, 2 bad input (one line on stderr).
"""

import argparse
import json
import math
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile


def bad_input(message):
    print("lammps.py: " + message, file=sys.stderr)
    sys.exit(2)


# ---- random numbers and packings, as granular/ has them -----------------------


class UniformRandom:
    """std::mt19937_64 and its upper 53 bits, solvers/random.h."""

    MASK = (1 << 64) - 1

    def __init__(self, seed):
        state = [seed & self.MASK]
        for i in range(1, 312):
            last = state[-1]
            state.append((6364136223846793005 * (last ^ (last >> 62)) + i) & self.MASK)
        self.state, self.index = state, 312

    def __call__(self):
        if self.index == 312:
            s = self.state
            for i in range(312):
                x = (s[i] & 0xFFFFFFFF80000000) | (s[(i + 1) % 312] & 0x7FFFFFFF)
                s[i] = s[(i + 156) % 312] ^ (x >> 1) ^ (0xB5026F5AA96619E9 if x & 1 else 0)
            self.index = 0
        x = self.state[self.index]
        self.index += 1
        x ^= (x >> 29) & 0x5555555555555555
        x ^= (x << 17) & 0x71D67FFFEDA60000
        x ^= (x << 37) & 0xFFF7EEE000000000
        x ^= x >> 43
        return (x >> 11) * 2.0**-53


class Packing:
    """Discs in the cell with edges (lx, 0) and (xy, ly)."""

    def __init__(self, path):
        try:
            with open(path, encoding="utf-8") as file:
                lines = file.read().splitlines()
        except (OSError, UnicodeDecodeError) as error:
            bad_input("cannot read %s: %s" % (path, getattr(error, "strerror", None) or error))
        try:
            count = int(lines[0])
            header = dict(
                (key, quoted or plain)
                for key, quoted, plain in re.findall(r'(\w+)=(?:"([^"]*)"|(\S+))', lines[1])
            )
            lattice = [float(v) for v in header["Lattice"].split()]
            columns, start = {}, 0
            fields = header["Properties"].split(":")
            for name, _, width in zip(fields[0::3], fields[1::3], fields[2::3]):
                columns[name] = start
                start += int(width)
            rows = [line.split() for line in lines[2 : 2 + count]]
            self.x = [[float(row[columns["pos"] + k]) for k in (0, 1)] for row in rows]
            self.radii = [float(row[columns["radius"]]) for row in rows]
            z = {float(row[columns["pos"] + 2]) for row in rows}
            self.alpha = float(header.get("alpha", 2.0))
            self.k = float(header.get("k", 1.0))
            if len(rows) != count or len(lattice) != 9 or count < 1:
                raise ValueError("truncated")
        except (ValueError, KeyError, IndexError) as error:
            bad_input("%s is no extended XYZ packing (%s)" % (path, str(error) or "truncated"))
        values = [v for x in self.x for v in x] + self.radii + lattice + [self.alpha, self.k]
        if not all(math.isfinite(v) for v in values) or min(self.radii) <= 0 or self.k <= 0:
            bad_input("%s holds a number that is not finite or not positive" % path)
        if len(z) > 1:
            bad_input("%s is not a packing of discs in the plane" % path)
        if "stiffness" in columns:
            bad_input("%s has grains of different stiffness" % path)
        self.edges = [[lattice[0], lattice[1]], [lattice[3], lattice[4]]]

    def deform(self, d):
        def times(v):
            return [d[0][0] * v[0] + d[0][1] * v[1], d[1][0] * v[0] + d[1][1] * v[1]]

        self.x = [times(v) for v in self.x]
        self.edges = [times(v) for v in self.edges]

    def perturb(self, amplitude, seed):
        random = UniformRandom(seed)
        for x in self.x:
            for k in (0, 1):
                x[k] += amplitude * (2 * random() - 1)

    def cell(self):
        (lx, zero), (xy, ly) = self.edges
        if zero != 0.0 or lx <= 0.0 or ly <= 0.0:
            bad_input("LAMMPS wants the first edge of the cell along x and the second upwards")
        return lx, ly, xy

    def contacts(self):
        """Yields i, j, delta, distance and the vector from j to i."""
        lx, ly, xy = self.cell()
        reach = 2 * max(self.radii)
        height = lx * ly / math.hypot(xy, ly)  # of the cell over its second edge
        nx, ny = max(1, int(height / reach)), max(1, int(ly / reach))
        if nx < 3 or ny < 3:
            bad_input("the cell is shorter than three grains")
        cells = {}
        for i, (x, y) in enumerate(self.x):
            b = y / ly
            a = (x - b * xy) / lx
            key = int((a - math.floor(a)) * nx) % nx, int((b - math.floor(b)) * ny) % ny
            cells.setdefault(key, []).append(i)
        for (cx, cy), members in cells.items():
            near = [
                j
                for dx in (-1, 0, 1)
                for dy in (-1, 0, 1)
                for j in cells.get(((cx + dx) % nx, (cy + dy) % ny), ())
            ]
            for i in members:
                for j in near:
                    if j <= i:
                        continue
                    x, y = self.x[i][0] - self.x[j][0], self.x[i][1] - self.x[j][1]
                    b = round(y / ly)
                    x, y = x - b * xy, y - b * ly
                    x -= round(x / lx) * lx
                    distance = math.hypot(x, y)
                    delta = self.radii[i] + self.radii[j] - distance
                    if delta > 0.0:
                        if distance == 0.0:
                            bad_input("grains %d and %d are at the same place" % (i, j))
                        yield i, j, delta, distance, x, y

    def energy_and_forces(self):
        """Energy, forces, mean contact force and the largest delta / (r_i + r_j)."""
        terms, magnitudes, depth = [], [], 0.0
        parts = [([], []) for _ in self.x]
        for i, j, delta, distance, x, y in self.contacts():
            terms.append(0.5 * self.k * delta * delta)
            f = self.k * delta
            magnitudes.append(f)
            depth = max(depth, delta / (delta + distance))
            for k, c in ((0, x), (1, y)):
                parts[i][k].append(f * c / distance)
                parts[j][k].append(-f * c / distance)
        forces = [[math.fsum(p[0]), math.fsum(p[1])] for p in parts]
        mean = math.fsum(magnitudes) / len(magnitudes) if magnitudes else 0.0
        return math.fsum(terms), forces, mean, depth


def largest(forces):
    return max(abs(f) for force in forces for f in force)


# ---- LAMMPS ---------------------------------------------------------------------


def write_input(packing, kinds, depth, options):
    lx, ly, xy = packing.cell()
    diameters = [2 * r for r in kinds]
    with open("packing.data", "w", encoding="ascii") as file:
        file.write("discs\n\n%d atoms\n%d atom types\n\n" % (len(packing.x), len(kinds)))
        file.write("0 %.17g xlo xhi\n0 %.17g ylo yhi\n-0.5 0.5 zlo zhi\n" % (lx, ly))
        if xy != 0.0:
            file.write("%.17g 0 0 xy xz yz\n" % xy)
        file.write("\nMasses\n\n" + "".join("%d 1\n" % (t + 1) for t in range(len(kinds))))
        file.write("\nAtoms # atomic\n\n")
        for i, (x, y) in enumerate(packing.x):
            file.write("%d %d %.17g %.17g 0\n" % (i + 1, kinds.index(packing.radii[i]) + 1, x, y))

    pairs = [(a, b) for a in range(len(kinds)) for b in range(a, len(kinds))]
    k, rows = packing.k, 16
    # Room for what a line search tries; closer pairs end the run with a message.
    inner = 1.0 - min(0.9999, max(0.1, 4.0 * depth))
    with open("pairs.table", "w", encoding="ascii") as file:
        for a, b in pairs:
            end = kinds[a] + kinds[b]
            file.write("\nPAIR_%d_%d\nN %d FPRIME %.17g %.17g\n\n" % (a + 1, b + 1, rows, -k, -k))
            for row in range(rows):
                r = end if row == rows - 1 else end * (inner + (1.0 - inner) * row / (rows - 1))
                delta = end - r
                file.write(
                    "%d %.17g %.17g %.17g\n" % (row + 1, r, 0.5 * k * delta * delta, k * delta)
                )

    skin = 0.1 * max(diameters)
    lines = [
        "units lj",
        "dimension 2",
        "boundary p p p",
        "atom_style atomic",
        "atom_modify map array",
        "box tilt large",
        "read_data packing.data",
        "neighbor %.17g bin" % skin,
        "neigh_modify every 1 delay 0 check yes",
        "pair_style table %s %d" % (options.table, options.points),
    ]
    for a, b in pairs:
        lines.append(
            "pair_coeff %d %d pairs.table PAIR_%d_%d %.17g"
            % (a + 1, b + 1, a + 1, b + 1, kinds[a] + kinds[b])
        )
    lines += [
        "fix plane all enforce2d",
        "thermo_style custom step pe fmax fnorm",
        "thermo_modify norm no format float %.17g",
        "thermo 1000000000",
        "run 0",
        "write_dump all custom start.dump id fx fy modify sort id format float %.17g",
        # The step of fire, in units of sqrt(m / k), grows up to tmax = 10 times
        # the first: 0.5, just under the limit of stability. Above it, from 0.1
        # on, runs take twenty times as long; the default of 0.005 takes nine
        # times as long. No coordinate moves by more than dmax at once; the
        # default of 0.1 is a length, here many diameters.
        "timestep %.17g" % (options.timestep / math.sqrt(packing.k)),
        "min_style " + options.style,
        "min_modify dmax %.17g norm inf" % (0.1 * min(diameters)),
        "minimize 0 %.17g %d %d"
        % (options.tolerance, options.max_iterations, 10 * options.max_iterations),
        "write_dump all custom end.dump id xu yu fx fy modify sort id format float %.17g",
    ]
    with open("in.relax", "w", encoding="ascii") as file:
        file.write("\n".join(lines) + "\n")


def read_dump(name):
    with open(name, encoding="ascii") as file:
        lines = file.read().splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("ITEM: ATOMS")) + 1
    return [[float(v) for v in line.split()[1:]] for line in lines[start:]]


def run_lammps(lmp):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = dict(os.environ, OMP_NUM_THREADS="1")
    with open("screen", "w", encoding="utf-8") as screen:
        status = subprocess.run(
            [lmp, "-in", "in.relax", "-log", "log.lammps", "-nocite", "-screen", "none"],
            stdout=screen,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            env=environment,
            check=False,
        ).returncode
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    log = ""
    if os.path.exists("log.lammps"):
        with open("log.lammps", encoding="utf-8", errors="replace") as file:
            log = file.read()
    if status != 0:
        errors = re.findall(r"^ERROR.*", log, re.MULTILINE)
        print(
            "lammps.py: LAMMPS gave up: %s" % (errors[0] if errors else "exit status %d" % status),
            file=sys.stderr,
        )
        sys.exit(1)
    return log, cpu


def parse(log):
    def found(pattern, text):
        match = re.search(pattern, text)
        if match is None:
            bad_input("the log of LAMMPS has no line like '%s'" % pattern)
        return match.group(1)

    minimization = log[log.index("minimize 0") :]
    number = r"([-+0-9.eE]+|nan|inf)"
    thermo = re.findall(r"^\s*\d+\s+(\S+)\s+(\S+)\s+(\S+)\s*$", minimization, re.MULTILINE)
    return {
        "stopping": found(r"Stopping criterion = (.*)", minimization).strip(),
        "iterations": int(found(r"Iterations, force evaluations = (\d+)", minimization)),
        "evaluations": int(found(r"Iterations, force evaluations = \d+ (\d+)", minimization)),
        "loop_seconds": float(found(r"Loop time of " + number, minimization)),
        "energy_initial": float(thermo[0][0]),
        "energy": float(thermo[-1][0]),
        "max_force": float(thermo[-1][1]),
    }


def write_packing(packing, path):
    lx, ly, xy = packing.cell()
    with open(path, "w", encoding="ascii") as file:
        file.write("%d\n" % len(packing.x))
        file.write(
            'Lattice="%.17g 0 0 %.17g %.17g 0 0 0 1" Properties=species:S:1:pos:R:3:radius:R:1 '
            'pbc="T T F" alpha=2 k=%.17g\n' % (lx, xy, ly, packing.k)
        )
        for (x, y), radius in zip(packing.x, packing.radii):
            file.write("A %.17g %.17g 0 %.17g\n" % (x, y, radius))


# ---- the command ----------------------------------------------------------------


class Parser(argparse.ArgumentParser):
    def error(self, message):
        bad_input(message)


def positive(text):
    value = float(text)
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError("%s must be positive" % text)
    return value


def finite(text):
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError("%s must be finite" % text)
    return value


def parse_arguments():
    parser = Parser(usage=__doc__, allow_abbrev=False, add_help=False)
    parser.add_argument("packing", nargs="?")
    parser.add_argument("--help", "-h", action="store_true")
    parser.add_argument("--style", choices=["cg", "fire"], default="cg")
    parser.add_argument("--tolerance_absolute", dest="tolerance", type=positive, default=1e-10)
    parser.add_argument("--radius_factor", type=positive, default=1.0)
    parser.add_argument("--simple_shear", type=finite, default=0.0)
    parser.add_argument("--perturb", type=finite, default=0.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out")
    parser.add_argument("--lmp", default="lmp")
    parser.add_argument("--timestep", type=positive, default=0.05)
    parser.add_argument("--points", type=int, default=4096)
    parser.add_argument("--table", choices=["spline", "linear"], default="spline")
    parser.add_argument("--max_iterations", type=int, default=1000000)
    options = parser.parse_args()
    if options.help:
        print(__doc__.strip())
        sys.exit(0)
    if options.packing is None:
        bad_input("which packing? (see --help)")
    if options.points < 16 or options.max_iterations < 1 or options.seed < 0:
        bad_input("--points >= 16, --max_iterations >= 1 and --seed >= 0, please")
    return options


def main():
    options = parse_arguments()
    packing = Packing(options.packing)
    if packing.alpha != 2.0:
        bad_input("%s has alpha = %g; only 2 can be tabulated exactly" % (options.packing, packing.alpha))
    lmp = shutil.which(options.lmp)
    if lmp is None:
        bad_input("there is no %s (Debian's package lammps has lmp)" % options.lmp)

    # As in experiments/relax, in units k = 1 and cell = 1.
    lx, ly, _ = packing.cell()
    options.tolerance *= packing.k * math.sqrt(lx * ly)
    # The load, in its order.
    packing.radii = [options.radius_factor * r for r in packing.radii]
    if options.simple_shear != 0.0:
        packing.deform([[1.0, options.simple_shear], [0.0, 1.0]])
    if options.perturb > 0.0:
        packing.perturb(options.perturb * math.sqrt(lx * ly), options.seed)
    kinds = sorted(set(packing.radii))
    if len(kinds) > 2:
        bad_input("%s has %d radii; at most two can be tabulated" % (options.packing, len(kinds)))
    energy, forces, mean_force, depth = packing.energy_and_forces()
    if energy == 0.0:
        bad_input("%s has no contacts" % options.packing)
    if options.table == "spline" and depth > 0.2:
        bad_input(
            "overlaps of %.2g contact distances are too deep for --table=spline; "
            "--table=linear --points=65536 copes, with larger errors" % depth
        )

    folder = options.out or tempfile.mkdtemp(prefix="granopt_lammps_")
    here = os.getcwd()
    try:
        try:
            os.makedirs(folder, exist_ok=True)
            os.chdir(folder)
            write_input(packing, kinds, depth, options)
        except OSError as error:
            bad_input("--out=%s: %s" % (folder, error.strerror))
        log, cpu = run_lammps(lmp)
        result = parse(log)
        start, end = read_dump("start.dump"), read_dump("end.dump")
        packing.x = [row[:2] for row in end]
        if options.out:
            write_packing(packing, "packing.xyz")
    finally:
        os.chdir(here)
        if not options.out:
            shutil.rmtree(folder, ignore_errors=True)

    error = max(abs(f - g) for a, b in zip(start, forces) for f, g in zip(a, b))
    result["energy_error"] = abs(result["energy_initial"] / energy - 1.0)
    result["force_error"] = error / mean_force
    # Judged by the true force law at the point that LAMMPS ended with.
    energy, forces, mean_force, _ = packing.energy_and_forces()
    result["true_energy"] = energy
    result["true_max_force"] = largest(forces)
    result["relative_residual"] = largest(forces) / mean_force if mean_force > 0.0 else 0.0
    result["cpu_seconds"] = round(cpu, 4)
    converged = result["max_force"] <= options.tolerance
    result["converged"] = converged
    result["peer"] = "lammps_" + options.style
    result["particles"] = len(packing.x)
    print(
        "LAMMPS %s: %s after %d iterations, %d evaluations, %.3g s (%s); max force %.2e, "
        "%.1e mean forces" % (
            options.style,
            "converged" if converged else "NOT converged",
            result["iterations"],
            result["evaluations"],
            result["loop_seconds"],
            result["stopping"],
            result["max_force"],
            result["relative_residual"],
        )
    )
    print(json.dumps(result))
    return 0 if converged else 1


if __name__ == "__main__":
    sys.exit(main())
