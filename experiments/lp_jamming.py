#!/usr/bin/env python3
"""The jamming point of a packing by a chain of linear programs: no energy, no
contact law, no minimizer, so that it checks `jamming` by other means.

  lp_jamming.py PACKING.xyz [--phi_j=PHI] [--contacts=CONTACTS.csv]
                [--shake=1e-6 --seed=1] [--bound=0.05] [--programs=50]

Grains are hard. Each is displaced at random by up to --shake mean diameters a
coordinate, and radii shrink until nothing overlaps; then, again and again, with
separations r and sums of radii D of pairs that could touch,

    maximize s   subject to   |r|^2 + 2 r.(dx_i - dx_j) >= s D^2,
                              |dx| <= bound, one grain fixed;
    x <- x + dx,   radii <- sqrt(s) radii,

until s - 1 is below roundoff. What is left out of |r + dx_i - dx_j|^2 is a square, so
that every state is free of overlaps. The dual variables of a program are the
contact forces of the packing that it ends with, up to a factor: those above zero
are its contacts, d N' - d + 1 of them among N' grains that are no rattlers. Pairs of
those that touch without a force, to roundoff, are redundant: with grains of two
sizes, geometry may close a contact that the others hold already.

A program is written in units of the gaps that are left, which makes the tolerances of
the solver relative to those; gaps are known from differences to the packing as it
is read, low parts included, in extended precision.

Compares with --phi_j, else the attribute phi_j of the packing, else "phi_j" of
summary.json in its folder; forces with --contacts, else contacts.csv there.
Prints a line for people each and one of JSON, the last of stdout.

Exit status: 0 done, 1 did not converge, 2 bad input (one line on stderr).

Source: Donev, Torquato, Stillinger, Connelly, J. Comput. Phys. 197 (2004) 139;
Torquato, Jiao, Phys. Rev. E 82 (2010) 061302. Deviations: the cell is fixed (theirs
deforms), and the programs end where double precision does.
"""

import argparse
import csv
import itertools
import json
import math
import os
import re
import sys

try:
    import numpy as np
    from scipy import sparse
    from scipy.optimize import linprog
    from scipy.spatial import cKDTree
except ImportError as missing:
    sys.stderr.write("lp_jamming.py: %s (apt install python3-scipy)\n" % missing)
    sys.exit(2)

EPSILON = 2.0**-52
# Below this part of the mean force a dual variable is none: simplex leaves exact
# zeros for what is not active.
NO_FORCE = 1e-9


def bad_input(message):
    sys.stderr.write("lp_jamming.py: %s\n" % message)
    sys.exit(2)


class Parser(argparse.ArgumentParser):
    def error(self, message):
        bad_input(message)


def read(path):
    try:
        with open(path, encoding="utf-8") as file:
            return file.read()
    except (OSError, UnicodeDecodeError) as error:
        bad_input("cannot read %s: %s" % (path, getattr(error, "strerror", None) or error))


class Packing:
    """cell: d x d, rows are edges; positions: N x d in extended precision."""

    def __init__(self, path):
        lines = read(path).splitlines()
        try:
            count = int(lines[0])
            self.header = {
                key: quoted or plain
                for key, quoted, plain in re.findall(r'(\w+)=(?:"([^"]*)"|(\S+))', lines[1])
            }
            lattice = np.array(self.header["Lattice"].split(), float).reshape(3, 3)
            columns, start = {}, 0
            fields = self.header["Properties"].split(":")
            for name, width in zip(fields[0::3], fields[2::3]):
                columns[name] = start
                start += int(width)
            rows = [line.split() for line in lines[2 : 2 + count]]
            if len(rows) != count or count < 2:
                raise ValueError("truncated")

            def column(name, width):
                at = columns[name]
                return np.array([[float(word) for word in row[at : at + width]] for row in rows])

            position, self.radii = column("pos", 3), column("radius", 1)[:, 0]
            low = column("pos_lo", 3) if "pos_lo" in columns else 0.0 * position
        except (ValueError, KeyError, IndexError) as error:
            bad_input("%s is no extended XYZ packing (%s)" % (path, str(error) or "truncated"))
        flat = self.header.get("pbc", "T T F").split()[-1:] == ["F"]
        self.d = d = 2 if flat else 3
        self.cell = lattice[:d, :d]
        self.positions = position[:, :d].astype(np.longdouble) + low[:, :d]
        if not np.isfinite(position).all() or not (np.isfinite(self.radii) & (self.radii > 0)).all():
            bad_input("%s holds a number that is not finite or not positive" % path)
        if not np.isfinite(self.cell).all() or np.linalg.det(self.cell) == 0:
            bad_input("%s:2: Lattice is singular" % path)

    def fraction(self):
        ball = math.pi if self.d == 2 else 4 * math.pi / 3
        return ball * math.fsum(self.radii**self.d) / abs(np.linalg.det(self.cell))

    def pairs(self, reach):
        """i, j, r (extended) of all pairs with |r| < (1 + reach) (r_i + r_j)."""
        inverse = np.linalg.inv(self.cell)
        fractions = (self.positions @ inverse).astype(float)
        back = np.floor(fractions)
        x = (fractions - back) @ self.cell
        most = (1 + reach) * 2 * self.radii.max()
        images = [math.ceil(most * np.linalg.norm(inverse[:, k])) for k in range(self.d)]
        tree = cKDTree(x)
        found = []
        for image in itertools.product(*(range(-m, m + 1) for m in images)):
            near = tree.query_ball_tree(cKDTree(x + np.array(image, float) @ self.cell), most)
            for i, others in enumerate(near):
                # Each pair once, by the sign of its image.
                found += [(i, j) + image for j in others if (image, i) > ((0,) * self.d, j)]
        found = np.array(sorted(found), int).reshape(-1, 2 + self.d)
        i, j = found[:, 0], found[:, 1]
        shift = -back[i] + back[j] - found[:, 2:]
        r = self.positions[i] - self.positions[j] + shift.astype(np.longdouble) @ self.cell.astype(
            np.longdouble
        )
        touch = self.radii[i] + self.radii[j]
        near = np.sqrt((r * r).sum(axis=1)) < (1 + reach) * touch
        return i[near], j[near], r[near], touch[near]


class Chain:
    """The state x + u with radii multiplied by sqrt(1 + growth)."""

    def __init__(self, packing, bound):
        self.packing, self.d = packing, packing.d
        self.length = 2 * packing.radii.mean()
        self.u = np.zeros(packing.positions.shape)
        self.bound = bound  # of |dx|, in units of the mean diameter
        self.i, self.j, r, touch = packing.pairs(4.0 * bound + 0.01)
        if not len(self.i):
            bad_input("no two grains are near each other")
        self.r, self.square = r.astype(float), touch**2
        # |r|^2 / D^2 - 1, rounded once.
        exact = (r * r).sum(axis=1) / touch.astype(np.longdouble) ** 2 - 1
        self.gap = exact.astype(float)
        self.growth = 0.0

    def gaps(self):
        """|r + s|^2 / D^2 - (1 + growth) of each pair: by differences."""
        s = self.u[self.i] - self.u[self.j]
        changed = (2 * (self.r * s).sum(axis=1) + (s * s).sum(axis=1)) / self.square
        return self.gap - self.growth + changed

    def step(self, unit):
        """One program in units of `unit`; returns what it gains, and the pairs with
        their dual variables and gaps."""
        n, d = self.u.shape
        gap = self.gaps()
        # Pairs that cannot meet are left out: the bound moves them by less.
        reach = 2 * math.sqrt(d) * self.limit(unit) * self.length
        direct = self.r + self.u[self.i] - self.u[self.j]
        slack = gap * self.square / np.sqrt((direct**2).sum(axis=1)) / 2
        chosen = np.nonzero(slack < reach + unit * self.length)[0]
        i, j = self.i[chosen], self.j[chosen]
        # dx = unit length y, s = 1 + unit t:
        #   t - 2 length r.(y_i - y_j) / D^2 <= gap / unit.
        weight = 2 * self.length * direct[chosen] / self.square[chosen][:, None]
        row = np.repeat(np.arange(len(chosen)), d)
        axis = np.tile(np.arange(d), len(chosen))
        ones = np.ones(len(chosen))
        matrix = sparse.csr_matrix(
            (
                np.concatenate([-weight.ravel(), weight.ravel(), ones]),
                (
                    np.concatenate([row, row, np.arange(len(chosen))]),
                    np.concatenate(
                        [d * np.repeat(i, d) + axis, d * np.repeat(j, d) + axis, np.full(len(chosen), d * n)]
                    ),
                ),
            ),
            shape=(len(chosen), d * n + 1),
        )
        most = self.limit(unit) / unit
        bounds = [(0.0, 0.0)] * d + [(-most, most)] * (d * (n - 1)) + [(None, None)]
        cost = np.zeros(d * n + 1)
        cost[-1] = -1.0
        result = linprog(
            cost,
            A_ub=matrix,
            b_ub=gap[chosen] / unit,
            bounds=bounds,
            method="highs-ds",
            options=dict(primal_feasibility_tolerance=1e-10, dual_feasibility_tolerance=1e-10),
        )
        if result.status != 0:
            return None
        y = result.x[:-1].reshape(n, d)
        self.u += unit * self.length * y
        gain = unit * result.x[-1] / (1 + self.growth)
        self.growth += unit * result.x[-1]
        return gain, chosen, -result.ineqlin.marginals

    def limit(self, unit):
        """The bound on |dx| over the mean diameter: soft modes move grains by many
        times a gap, but a linear program is only good for small steps."""
        return min(self.bound, 1e4 * unit)


def own_phi_j(arguments, packing):
    if arguments.phi_j is not None:
        return arguments.phi_j
    if "phi_j" in packing.header:
        try:
            return float(packing.header["phi_j"])
        except ValueError:
            bad_input("%s:2: phi_j=%s is not a number" % (arguments.packing, packing.header["phi_j"]))
    path = os.path.join(os.path.dirname(arguments.packing), "summary.json")
    if os.path.exists(path):
        try:
            return float(json.loads(read(path))["phi_j"])
        except (ValueError, KeyError, TypeError):
            return None
    return None


def own_forces(arguments):
    """{(i, j): forces of its images} of the contacts of rigid grains, or None."""
    path = arguments.contacts or os.path.join(os.path.dirname(arguments.packing), "contacts.csv")
    if not arguments.contacts and not os.path.exists(path):
        return None
    forces = {}
    try:
        for row in csv.DictReader(read(path).splitlines()):
            if int(row["rigid"]):
                key = tuple(sorted((int(row["i"]), int(row["j"]))))
                forces.setdefault(key, []).append(float(row["force"]))
    except (KeyError, ValueError, TypeError) as error:
        bad_input("%s is no file of contacts (%s)" % (path, error))
    return forces


def compare_forces(ours, theirs):
    """Largest difference in mean forces, or None for other contacts."""
    if {key: len(value) for key, value in ours.items()} != {
        key: len(value) for key, value in theirs.items()
    }:
        return None
    first, second = [], []
    for key in sorted(ours):
        first += sorted(ours[key])
        second += sorted(theirs[key])
    first, second = np.array(first), np.array(second)
    return float(np.max(np.abs(first / first.mean() - second / second.mean())))


def main():
    parser = Parser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("packing")
    parser.add_argument("--phi_j", type=float)
    parser.add_argument("--contacts", default="")
    parser.add_argument("--shake", type=float, default=1e-6)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--bound", type=float, default=0.05)
    parser.add_argument("--programs", type=int, default=50)
    arguments = parser.parse_args()
    if not 0 <= arguments.shake <= 0.01:
        bad_input("--shake=%g must be in [0, 0.01]" % arguments.shake)
    if not 0 <= arguments.seed < 2**32:
        bad_input("--seed=%d must be in [0, 2^32)" % arguments.seed)
    if not 0 < arguments.bound <= 0.2:
        bad_input("--bound=%g must be in (0, 0.2]" % arguments.bound)
    if not 1 <= arguments.programs <= 10000:
        bad_input("--programs=%d must be in [1, 10000]" % arguments.programs)
    packing = Packing(arguments.packing)
    theirs, phi_j = own_forces(arguments), own_phi_j(arguments, packing)
    phi, d = packing.fraction(), packing.d

    chain = Chain(packing, arguments.bound)
    deepest = float(chain.gap.min())
    if deepest < -0.1:
        bad_input("%s: grains overlap by %.2g of their distance" % (arguments.packing, -deepest / 2))
    random = np.random.RandomState(arguments.seed)
    chain.u += arguments.shake * chain.length * random.uniform(-1, 1, chain.u.shape)
    chain.growth = float(chain.gaps().min())
    # Of the order of the gaps that this opens.
    unit = max(abs(chain.growth), 8 * EPSILON)
    converged, programs, gain = False, 0, math.inf
    while programs < arguments.programs:
        result = chain.step(unit)
        if result is None:
            break
        programs += 1
        gain, pairs, dual = result
        sys.stderr.write(
            "program %d: %d pairs, radii grow by %.2e\n" % (programs, len(pairs), 0.5 * gain)
        )
        active = dual > NO_FORCE * dual[dual > 0].mean() if (dual > 0).any() else dual > 0
        # What is left: the squares that the program did not know of.
        left = float(np.abs(chain.gaps()[pairs[active]]).max()) if active.any() else 0.0
        if abs(gain) <= 4 * EPSILON or left <= 4 * EPSILON:
            converged = True
            break
        unit = min(max(left, 8 * EPSILON), max(abs(gain), 8 * EPSILON))

    if programs == 0:
        sys.stderr.write("lp_jamming.py: the first program has no solution\n")
        return 1
    force = dual[active] * np.sqrt(((chain.r + chain.u[chain.i] - chain.u[chain.j]) ** 2).sum(axis=1))[
        pairs[active]
    ]
    force /= chain.square[pairs[active]]
    i, j = chain.i[pairs[active]], chain.j[pairs[active]]
    grains = len(set(i) | set(j))
    # Pairs that touch all the same.
    rigid = np.zeros(len(packing.radii), bool)
    rigid[i] = rigid[j] = True
    closed = (np.abs(chain.gaps()) <= max(64 * EPSILON, 1e-3 * abs(gain))) & rigid[chain.i] & rigid[chain.j]
    closed[pairs[active]] = False
    ours = {}
    for a, b, f in zip(i, j, force):
        ours.setdefault((min(a, b), max(a, b)), []).append(f)
    # phi ((1 + growth)^(d/2) - 1), without cancellation.
    change = phi * math.expm1(0.5 * d * math.log1p(chain.growth))
    report = dict(
        phi_j=phi + change,
        converged=converged,
        programs=programs,
        last_gain=0.5 * gain,
        rigid_grains=grains,
        rattlers=len(packing.radii) - grains,
        active=int(active.sum()),
        isostatic=d * grains - d + 1,
        redundant=int(closed.sum()),
    )
    print("phi_J = %.15f, %d programs%s" % (phi + change, programs, "" if converged else ": NOT CONVERGED"))
    print(
        "  active        %d constraints among %d grains (isostatic: %d); %d rattlers"
        % (report["active"], grains, report["isostatic"], report["rattlers"])
    )
    if report["redundant"]:
        print("  redundant     %d more pairs of them touch without a force" % report["redundant"])
    if phi_j is not None:
        report["own_phi_j"], report["difference"] = phi_j, (phi - phi_j) + change
        print("  difference    %+.1e to phi_J = %.15f of the packing" % (report["difference"], phi_j))
    if theirs is not None:
        report["force_difference"] = compare_forces(ours, theirs)
        print(
            "  forces        %s"
            % (
                "not on the same contacts"
                if report["force_difference"] is None
                else "on the same contacts, the largest difference %.1e mean forces" % report["force_difference"]
            )
        )
    print(json.dumps(report))
    return 0 if converged else 1


if __name__ == "__main__":
    sys.exit(main())
