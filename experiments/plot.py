"""The figures of the experiments, from the files that they write.

    plot.py packing PACKING.xyz CONTACTS.csv OUT [--title=T]
        discs (3D: a projection) with force chains
    plot.py stages DIR OUT
        stage_initial.xyz, stage_unjammed.xyz, packing.xyz + contacts.csv
    plot.py path PATH.csv OUT [--phi_j=PHI] [--alpha=2] [--dimension=2]
        energy, pressure and coordination along a jamming path
    plot.py mode MODES.xyz CONTACTS.csv MODES.csv OUT [--number=1]
        a normal mode: arrows on the packing
    plot.py trace TRACE.csv OUT
        residual against iterations and seconds
    plot.py curves CURVES.csv OUT [--cases=A;B] [--level=relative:1e-10 ...]
        of `compare`: residual against iterations and CPU time, a row a case
    plot.py work EVENTS.csv OUT [--cases=A;B] [--level=relative:1e-10 ...]
        of `compare`: the residual that a number of evaluations, a CPU time buys
    plot.py distances STEP_TABLES.csv OUT [--steps=all] [--level=relative:1e-10 ...]
        of `compare`: what shear steps cost against the distance to jamming
    plot.py fig7 STEP_TABLES.csv OUT [--level=relative:1e-7]
        of `compare --paper=fig7`: means and standard deviations of the same
    plot.py profile PROFILE.csv OUT
        of `compare`: the part of the problems within a factor of the cheapest method
    plot.py quality QUALITY.csv OUT
        of `compare`: the part of the problems that end near the best, and where the
        reference does
    plot.py protocol jamming|shear DIR OUT [--epsilon=1e-6] [--reference=LABEL]
        of `compare --protocol`: what came out of whole protocols
    plot.py conditioning CONDITIONING.csv CONTACT_CHANGES.csv OUT
        condition numbers and contact changes against the distance to jamming
    plot.py ensemble ENSEMBLE.csv OUT [--dimension=2]
        of `jamming --seeds`: histograms of phi_J, a row a number of grains
    plot.py finite_size SIZES.csv OUT [--dimension=2]
            [--fit=PHI,ERROR,C,ERROR,EXPONENT]
        mean phi_J against the number of grains, and PHI - C N^-EXPONENT
    plot.py scaling SCALING.csv OUT
        what a grain costs against the number of grains (experiments/scaling.sh)
    plot.py shear CURVES.csv|BANDS.csv OUT [--mode=pure|simple|bulk] [--first=phi]
        of `shear`: stress and fabric against strain, a line an increment; of several
        seeds the mean with its 20 and 80 % quantiles
    plot.py event DIR OUT
        of `shear --events`: the largest plastic event
    plot.py events EVENTS.csv OUT
        of `shear --events`: sizes of plastic events
    plot.py walls DIR OUT
        of `shear --mode=wall`: stresses of the wall, and how the grains follow it
    plot.py stress STRESS.csv OUT [--yields=STRESS]
        of `shear --mode=stress`: strain, pressure and volume against shear stress
    plot.py dynamics DYNAMICS.csv OUT
        of `shear --dynamics`: states of damped motion against those of a minimizer
    plot.py grain_cost GRAIN_COST.csv OUT
        what a grain costs against the number of grains (experiments/grain_cost.sh)
    plot.py laws STATES.csv OUT [--exponents=EXPONENTS.csv]
        of `scaling`: pressure, moduli, coordination against the distance to jamming
    plot.py collapse STATES.csv OUT
        of `scaling`: shear modulus and excess contacts of all sizes against P N^2
    plot.py vibrations SPECTRUM.csv OUT
        of `scaling`: density of states and participation ratios
    plot.py tradeoff TRADEOFF.csv OUT
        of `tradeoff`: the error of what users want against CPU time
    plot.py tradeoff_flow TRADEOFF_FLOW.csv OUT
        of `tradeoff --flow`: errors of a flow against CPU time
    plot.py phi_j JAMMING.csv OUT
        of `tradeoff`: what sharper jamming points cost
    plot.py fidelity FIDELITY.csv OUT [--accuracy=0.05]
        of `fidelity`: what each ingredient costs, and what leaving it out changes
    plot.py extremes EXTREMES.csv OUT
        of `extremes`: what became of every method at every extreme
    plot.py distributions FORCES.csv GAPS.csv DISTRIBUTIONS.csv OUT
        cumulative distributions of weak forces and small gaps
    plot.py flow_start START.xyz OUT
        of `flow`: spheres in their cube
    plot.py flow_run ENERGY.csv OUT
        of `flow`: energies and ledger of one run
    plot.py flow_fractions|flow_energy|flow_boundary ENERGY.csv OUT
        of `flow --paper`: figures 5 and 6, and what jumps at the boundary put in
    plot.py flow_work|flow_remark8|flow_throughput TABLE.csv OUT
    plot.py flow_oscillator DECAY.csv RESPONSE.csv OUT
        of `flow --study`
    plot.py identify_convergence|identify_response|identify_profile|
            identify_alternatives TABLE.csv OUT
    plot.py identify_valley FRESH.csv STRINGS.csv OUT
        of `identify`: figures 7 and 8, least values with one parameter fixed, other
        searches, strings that are equally good

Each writes OUT.svg and OUT.png, both or neither. The same input gives the same
bytes. Bad input or usage: one line on stderr, status 2.
"""

import argparse
import csv
import io
import itertools
import math
import os
import re
import sys
import textwrap
from collections import namedtuple

try:
  import numpy as np
  import matplotlib
  matplotlib.use("Agg")
  from matplotlib import pyplot as plt
  from matplotlib import ticker
  from matplotlib.collections import (EllipseCollection, LineCollection,
                                      PathCollection)
  from matplotlib.lines import Line2D
  from matplotlib.offsetbox import (AnchoredOffsetbox, DrawingArea, HPacker,
                                    TextArea, VPacker)
  from matplotlib.patches import Circle, PathPatch, Polygon, Rectangle
  from matplotlib.path import Path
except ImportError as error:
  sys.stderr.write("plot.py: %s (apt install python3-matplotlib)\n" % error)
  sys.exit(2)

# Colours of Okabe and Ito, which the colour-blind tell apart, and pale fills of
# different lightness.
BLUE, ORANGE, GREEN, VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
PURPLE = "#CC79A7"
INK, GREY, PALE = "#22262B", "#6B737C", "#D9DDE1"
SPECIES_FILLS = ("#BCD6EA", "#F6E7C4", "#CFE6D8", "#E9D3E2")
SPECIES_NODES = ("#4C9BD0", "#F2B93B", "#2FA57F", PURPLE)  # in projections
WEAK, MEAN, STRONG = "#E0906E", "#B5301F", "#5A0713"  # force chains
FOG = "#E4E9EE"

DPI = 180
MAX_FORCE = 6.0  # of the mean; stronger contacts are drawn as this one
MIN_FORCE = 0.03  # drawn as hairlines below
HATCH_ABOVE = 4.5  # points of mean radius; smaller rattlers are white
RASTER_ABOVE = 20000  # grains; discs and chains are then a picture in the SVG

STYLE = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 12.5,
    "mathtext.fontset": "dejavusans",
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.9,
    "axes.labelsize": 14,
    "axes.titlesize": 13.5,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.major.size": 5,
    "ytick.major.size": 5,
    "xtick.minor.size": 2.5,
    "ytick.minor.size": 2.5,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "svg.hashsalt": "granopt",
    "svg.fonttype": "path",
}


class InputError(Exception):
  """One line that says what is wrong, and where."""


# ---------------------------------------------------------------- input


Packing = namedtuple("Packing", "cell positions radii species")
# cell: d x d, rows are edges; positions: N x d; species: N indices; names in order.
Contacts = namedtuple("Contacts", "i j force distance normal rigid")


def ReadText(path):
  try:
    with open(path, encoding="utf-8") as file:
      return file.read()
  except (OSError, UnicodeDecodeError) as error:
    raise InputError("%s: %s" % (path, getattr(error, "strerror", None) or error))


def ReadPacking(path):
  lines = ReadText(path).splitlines()
  try:
    count = int(lines[0])
    header = lines[1]
  except (IndexError, ValueError):
    raise InputError("%s:1: the number of grains and a header line are missing" % path)
  values = {key: quoted or plain for key, quoted, plain in
            re.findall(r'(\w+)=(?:"([^"]*)"|(\S+))', header)}
  try:
    lattice = np.array(values["Lattice"].split(), float).reshape(3, 3)
  except (KeyError, ValueError):
    raise InputError('%s:2: Lattice="..." with nine numbers is missing' % path)
  fields = values.get("Properties", "").split(":")
  columns, at = {}, 0
  for name, width in zip(fields[0::3], fields[2::3]):
    if not width.isdigit():
      raise InputError("%s:2: Properties: bad width %r of %r" % (path, width, name))
    columns[name] = at
    at += int(width)
  if "pos" not in columns or "radius" not in columns:
    raise InputError("%s:2: Properties lacks pos or radius" % path)
  if count < 1 or len(lines) < 2 + count:
    raise InputError("%s: %d grains announced, %d lines follow" %
                     (path, count, len(lines) - 2))
  positions, radii, names = np.empty((count, 3)), np.empty(count), []
  pos, radius, kind = columns["pos"], columns["radius"], columns.get("species")
  for k in range(count):
    words = lines[2 + k].split()
    try:
      positions[k] = [float(word) for word in words[pos:pos + 3]]
      radii[k] = float(words[radius])
      names.append("A" if kind is None else words[kind])
    except (IndexError, ValueError):
      raise InputError("%s:%d: expected %d columns with numbers for pos and radius" %
                       (path, 3 + k, at))
  if not (np.isfinite(positions).all() and np.isfinite(radii).all() and
          (radii > 0).all()):
    raise InputError("%s: positions must be finite and radii positive" % path)
  if "pbc" in values:
    flat = values["pbc"].split()[-1:] == ["F"]
  else:
    flat = np.ptp(positions[:, 2]) == 0
  d = 2 if flat else 3
  cell = lattice[:d, :d]
  if not np.isfinite(cell).all() or np.linalg.det(cell) == 0:
    raise InputError("%s:2: Lattice is singular" % path)
  # Species by size, so that the smallest are always drawn alike.
  order = sorted(set(names), key=lambda name: (
      np.mean(radii[[k for k in range(count) if names[k] == name]]), name)) \
      if len(set(names)) <= 8 else sorted(set(names))
  index = {name: k for k, name in enumerate(order)}
  return Packing(cell, positions[:, :d], radii,
                 (order, np.array([index[name] for name in names])))


def ReadVectors(path, name, packing):
  """A column of three numbers a grain of a file that ReadPacking() has read."""
  lines = ReadText(path).splitlines()
  fields = re.search(r"Properties=(\S+)", lines[1]).group(1).strip('"').split(":")
  at = 0
  for field, width in zip(fields[0::3], fields[2::3]):
    if field == name:
      break
    at += int(width)
  else:
    raise InputError("%s:2: Properties lacks %s" % (path, name))
  count, d = packing.positions.shape
  vectors = np.empty((count, 3))
  for k in range(count):
    try:
      vectors[k] = [float(word) for word in lines[2 + k].split()[at:at + 3]]
    except ValueError:
      raise InputError("%s:%d: %s: three numbers expected" % (path, 3 + k, name))
  if not np.isfinite(vectors).all() or not vectors.any():
    raise InputError("%s: %s must be finite and not zero" % (path, name))
  return vectors[:, :d]


def ReadTable(path, required, words=(), optional=()):
  """Columns by name: arrays of numbers, lists of strings for those in `words`. Ones
  in `optional` that older files lack are not in the result."""
  try:
    rows = list(csv.reader(ReadText(path).splitlines()))
  except csv.Error as error:
    raise InputError("%s: %s" % (path, error))
  if not rows:
    raise InputError("%s: empty, expected the columns %s" % (path, ",".join(required)))
  names = [name.strip() for name in rows[0]]
  missing = [name for name in required if name not in names]
  if missing:
    raise InputError("%s:1: no column %s" % (path, ", ".join(missing)))
  required = (*required, *(name for name in optional if name in names))
  at = {name: names.index(name) for name in required}
  table = {name: [] for name in required}
  for line, row in enumerate(rows[1:], 2):
    if not row:
      continue
    for name in required:
      try:
        word = row[at[name]].strip()
        table[name].append(word if name in words else float(word))
      except IndexError:
        raise InputError("%s:%d: %d columns, expected %d" %
                         (path, line, len(row), len(names)))
      except ValueError:
        raise InputError("%s:%d: %s: %r is not a number" % (path, line, name, word))
  return {name: column if name in words else np.array(column, float)
          for name, column in table.items()}


def ReadContacts(path, packing):
  count, d = packing.positions.shape
  table = ReadTable(path, ("i", "j", "force", "distance", "nx", "ny", "nz", "rigid"))
  for name, column in table.items():
    if not np.isfinite(column).all():
      raise InputError("%s: %s is not finite" % (path, name))
  i, j = table["i"].astype(int), table["j"].astype(int)
  if len(i) and (min(i.min(), j.min()) < 0 or max(i.max(), j.max()) >= count):
    raise InputError("%s: a contact names a grain outside 0..%d" % (path, count - 1))
  far = table["distance"] > 1.01 * (packing.radii[i] + packing.radii[j])
  if far.any():
    raise InputError("%s: grains %d and %d of this packing cannot touch at distance %g" %
                     (path, i[far][0], j[far][0], table["distance"][far][0]))
  normal = np.column_stack([table[name] for name in ("nx", "ny", "nz")[:d]])
  return Contacts(i, j, table["force"], table["distance"], normal,
                  table["rigid"] != 0)


# ---------------------------------------------------------------- numbers


def PackingFraction(packing):
  d = packing.positions.shape[1]
  ball = math.pi if d == 2 else 4 * math.pi / 3
  return ball * np.sum(packing.radii**d) / abs(np.linalg.det(packing.cell))


def Rattlers(packing, contacts):
  """True for a grain without a rigid contact."""
  rattler = np.ones(len(packing.radii), bool)
  rattler[contacts.i[contacts.rigid]] = False
  rattler[contacts.j[contacts.rigid]] = False
  return rattler & ~Walls(packing)


def Walls(packing):
  """True for a grain of a wall, which need not be held by contacts."""
  names, species = packing.species
  return (species == names.index("wall") if "wall" in names
          else np.zeros(len(species), bool))


def MarkedRattlers(packing, contacts):
  """As above, but none if all are: the word then says nothing about a grain."""
  rattler = (np.zeros(len(packing.radii), bool) if contacts is None
             else Rattlers(packing, contacts))
  return rattler & ~rattler.all()


def Pressure(packing, contacts):
  d = packing.positions.shape[1]
  return (np.dot(contacts.force, contacts.distance) /
          (d * abs(np.linalg.det(packing.cell))))


def Coordination(packing, contacts):
  rigid_grains = np.sum(~Rattlers(packing, contacts))
  return 2 * np.sum(contacts.rigid) / rigid_grains if rigid_grains else 0.0


def MeanForce(contacts):
  return np.mean(contacts.force[contacts.force > 0])


def Scientific(value):
  """3 digits, as mathtext without the dollars."""
  if value == 0:
    return "0"
  if 1e-2 <= abs(value) < 1e4:
    return "%.3g" % value
  mantissa, exponent = ("%.2e" % value).split("e")
  return r"%s\times10^{%d}" % (mantissa, int(exponent))


def Power(value):
  """10^-4, or 3 x 10^-4, as mathtext without the dollars."""
  exponent = math.floor(math.log10(value) + 1e-9)
  mantissa = "%.3g" % (value / 10.0**exponent)
  return r"%s10^{%d}" % ("" if mantissa == "1" else mantissa + r"\times", exponent)


def Describe(packing, contacts):
  """`N = ...  phi = ...  p = ...  z = ...  rattlers`."""
  words = ["$N = %d$" % len(packing.radii),
           r"$\phi = %.5f$" % PackingFraction(packing)]
  if Walls(packing).any():
    # The cell is not what is filled.
    return ["$N = %d$ and %d grains of walls" % (np.sum(~Walls(packing)),
                                               np.sum(Walls(packing)))]
  if contacts is not None:
    rattlers = int(Rattlers(packing, contacts).sum())
    words.append("$p = %s$" % Scientific(Pressure(packing, contacts)))
    if rattlers == len(packing.radii):
      words.append("no rigid grains")
    else:
      words.append("$z = %.3f$" % Coordination(packing, contacts))
      words.append("%s rattler%s" % (rattlers or "no", "" if rattlers == 1 else "s"))
  return words


# ---------------------------------------------------------------- packings


def Mix(first, second, t):
  a = np.array(matplotlib.colors.to_rgb(first))
  b = np.array(matplotlib.colors.to_rgb(second))
  return matplotlib.colors.to_hex((1 - t) * a + t * b)


def ForceColour(force):
  """Of a force over the mean one."""
  if force < 1:
    return Mix(WEAK, MEAN, force)
  return Mix(MEAN, STRONG, min(1.0, (force - 1) / 3))


class View:
  """Where a packing is drawn: axes fitted to the cell and a border of copies.

  The axes fill as much of the given space (inches) as the cell's shape allows.
  `border`, a length, is chosen unless given (so that panels look alike).
  """

  def __init__(self, figure, packing, left, bottom, width, height, border=None):
    self.packing = packing
    self.d = packing.positions.shape[1]
    cell = packing.cell
    mean_radius = np.mean(packing.radii)
    # Distances between opposite faces, and the border in units of them.
    inverse = np.linalg.inv(cell)
    self.heights = 1 / np.linalg.norm(inverse, axis=0)
    if border is None:
      border = min(1.3 * mean_radius, 0.06 * self.heights.min())
    self.border = border
    self.margin = border / self.heights if self.d == 2 else np.zeros(3)
    corners = np.array(list(itertools.product((0, 1), repeat=self.d)))
    spread = corners + np.where(corners > 0, 1, -1) * self.margin
    points = (spread @ cell)[:, :2]
    pad = 0.01 * np.ptp(points) if self.d == 2 else 1.2 * mean_radius
    low, high = points.min(axis=0) - pad, points.max(axis=0) + pad
    scale = min(width / (high - low)[0], height / (high - low)[1])
    size = scale * (high - low)
    total = figure.get_size_inches()
    self.ax = figure.add_axes([
        (left + (width - size[0]) / 2) / total[0],
        (bottom + (height - size[1]) / 2) / total[1],
        size[0] / total[0], size[1] / total[1]])
    self.ax.set_axis_off()
    self.ax.set_xlim(low[0], high[0])
    self.ax.set_ylim(low[1], high[1])
    self.points = 72 * scale  # per unit of length
    # Of a line for f = <f>.
    self.unit_width = min((0.24 if self.d == 2 else 0.11) * mean_radius * self.points,
                          4.0)
    # Into the cell.
    self.fractions = packing.positions @ inverse
    self.fractions -= np.floor(self.fractions)
    self.inverse = inverse

  def Ring(self, grow):
    """Corners of the 2D cell, grown by `grow` borders."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    corners += np.where(corners > 0, 1, -1) * grow * self.margin
    return corners @ self.packing.cell

  def Copies(self, low, high):
    """Periodic copies of things that span the fractions low..high (n x d) and
    reach into the cell or its border: their indices and their shifts."""
    reach = [range(math.floor(-m - h), math.ceil(1 + m - l) + 1)
             for m, l, h in zip(self.margin, low.min(axis=0), high.max(axis=0))]
    which, shifts = [], []
    for shift in itertools.product(*reach):
      inside = np.all((low + shift < 1 + self.margin) &
                      (high + shift > -self.margin), axis=1)
      index = np.nonzero(inside)[0]
      which.append(index)
      shifts.append(np.tile(np.array(shift, float), (len(index), 1)))
    return np.concatenate(which), np.concatenate(shifts)


def DrawDiscs(view, rattler):
  packing, cell = view.packing, view.packing.cell
  reach = packing.radii[:, None] / view.heights
  which, shifts = view.Copies(view.fractions - reach, view.fractions + reach)
  centres = (view.fractions[which] + shifts) @ cell
  species = packing.species[1]
  radius = np.mean(packing.radii) * view.points
  edge = min(0.8, max(0.2, 0.05 * radius))
  hatched = radius > HATCH_ABOVE
  raster = len(packing.radii) > RASTER_ABOVE
  artists = []
  for kind in range(len(packing.species[0])):
    for loose in (False, True):
      of_kind = (species[which] == kind) & (rattler[which] == loose)
      fill = "white" if loose else SPECIES_FILLS[kind % len(SPECIES_FILLS)]
      line = GREY if loose else Mix(fill, INK, 0.45)
      # One collection a size: in the SVG, the disc once and a `use` per grain.
      sizes = np.unique(packing.radii[which[of_kind]])
      groups = ([of_kind & (packing.radii[which] == size) for size in sizes]
                if len(sizes) <= 16 else [of_kind])
      for group in groups:
        diameters = 2 * packing.radii[which[group]]
        # One shape, many times, is a small file; half a percent is not seen.
        if np.ptp(diameters) <= 0.005 * diameters.mean():
          diameters = diameters[:1]
        artists.append(view.ax.add_collection(EllipseCollection(
            diameters, diameters, np.zeros(len(diameters)), units="xy",
            offsets=centres[group], transOffset=view.ax.transData,
            facecolors=fill, edgecolors=line, linewidths=edge,
            hatch="////" if loose and hatched else None, zorder=1,
            rasterized=raster)))
  return artists


def ForceGroups(view, contacts):
  """Segments of the contact network in groups of (nearly) one force and depth:
  a list of (depth in 0..1, force / mean, n x 2 x 2), from the back and weak."""
  if contacts is None or not np.any(contacts.force > 0):
    return []
  strength = contacts.force / MeanForce(contacts)
  start = view.fractions[contacts.j]
  step = (contacts.distance[:, None] * contacts.normal) @ view.inverse
  end = start + step
  if view.d == 2:
    which, shifts = view.Copies(np.minimum(start, end), np.maximum(start, end))
    start, end = start[which] + shifts, end[which] + shifts
  else:
    # What leaves the cell: a half at each of the two grains.
    leaves = np.any(np.floor(end) != 0, axis=1)
    back = view.fractions[contacts.i[leaves]]
    end[leaves] -= step[leaves] / 2
    which = np.concatenate([np.arange(len(start)), np.nonzero(leaves)[0]])
    start = np.concatenate([start, back])
    end = np.concatenate([end, back - step[leaves] / 2])
  drawn = strength[which] > 1e-3
  which, start, end = which[drawn], start[drawn], end[drawn]
  ends = np.stack([start @ view.packing.cell, end @ view.packing.cell], axis=1)
  level = np.rint(np.log(np.clip(strength[which], MIN_FORCE, MAX_FORCE)) /
                  math.log(1.08)).astype(int)
  depth = (np.zeros(len(which), int) if view.d == 2
           else Depth((start + end) / 2))
  groups = []
  for key in sorted(set(zip(depth.tolist(), level.tolist()))):
    chosen = (depth == key[0]) & (level == key[1])
    groups.append((key[0] / DEPTHS, 1.08**key[1], ends[chosen][:, :, :2]))
  return groups


DEPTHS = 12


def Depth(fractions):
  """Slice 0 (back) .. DEPTHS (front, towards +z)."""
  return np.clip(np.rint(DEPTHS * fractions[:, 2]), 0, DEPTHS).astype(int)


def Segments(view, groups, colour):
  """One compound path a group, drawn in order."""
  paths, widths, colours = [], [], []
  for depth, strength, ends in groups:
    codes = np.tile([Path.MOVETO, Path.LINETO], len(ends))
    path = Path(ends.reshape(-1, 2), codes)
    path.should_simplify = False
    paths.append(path)
    widths.append(strength * view.unit_width)
    colours.append(colour(depth, strength))
  return view.ax.add_collection(PathCollection(
      paths, facecolors="none", edgecolors=colours, linewidths=widths,
      capstyle="round", zorder=2,
      rasterized=len(view.packing.radii) > RASTER_ABOVE))


def DrawFlat(view, contacts, draw=None):
  """Force chains, or what `draw` draws, on discs."""
  artists = DrawDiscs(view, MarkedRattlers(view.packing, contacts))
  groups = [] if draw else ForceGroups(view, contacts)
  if draw:
    artists += draw()
  if groups:
    artists.append(Segments(view, groups, lambda depth, force: ForceColour(force)))
  clip = Polygon(view.Ring(1.0), transform=view.ax.transData)
  for artist in artists:
    artist.set_clip_path(clip)
  # Copies outside of the cell are faded.
  outside, inside = view.Ring(1.1), view.Ring(0.0)
  veil = Path(np.concatenate([outside, outside[:1], inside[::-1], inside[-1:]]),
              ([Path.MOVETO] + 3 * [Path.LINETO] + [Path.CLOSEPOLY]) * 2)
  view.ax.add_patch(PathPatch(veil, facecolor="white", alpha=0.66, linewidth=0,
                              zorder=3))
  view.ax.add_patch(Polygon(inside, fill=False, edgecolor=INK, linewidth=1.0,
                            joinstyle="miter", zorder=4))


def Fogged(colour, depth):
  return Mix(FOG, colour, depth**2)


NODE = 0.26  # of a grain's radius


def DrawProjection(view, contacts):
  cell, packing = view.packing.cell, view.packing
  rattler = MarkedRattlers(packing, contacts)
  corners = list(itertools.product((0, 1), repeat=3))
  edges = [[np.dot(a, cell)[:2], np.dot(b, cell)[:2]]
           for a, b in itertools.combinations(corners, 2)
           if np.abs(np.subtract(a, b)).sum() == 1]
  view.ax.add_collection(LineCollection(edges, colors=GREY, linewidths=0.8,
                                        zorder=1))
  slices = Depth(view.fractions)
  centres = (view.fractions @ cell)[:, :2]
  groups = ForceGroups(view, contacts)
  for level in range(DEPTHS + 1):
    depth = level / DEPTHS
    here = [group for group in groups if group[0] == depth]
    if here:
      Segments(view, here, lambda depth, force: Fogged(STRONG, depth)).set_zorder(
          2 + level)
    for kind in range(len(packing.species[0])):
      for loose in (False, True):
        chosen = ((slices == level) & (packing.species[1] == kind) &
                  (rattler == loose))
        if not chosen.any():
          continue
        fill = SPECIES_NODES[kind % len(SPECIES_NODES)]
        size = 2 * NODE * np.mean(packing.radii[chosen])
        view.ax.add_collection(EllipseCollection(
            [size], [size], [0.0], units="xy", offsets=centres[chosen],
            transOffset=view.ax.transData,
            facecolors="white" if loose else Fogged(fill, depth),
            edgecolors=Fogged(INK, depth), linewidths=0.7, zorder=2.5 + level))


def Draw(view, contacts):
  (DrawFlat if view.d == 2 else DrawProjection)(view, contacts)


def Key(figure, view, contacts, bottom, size=12.5):
  """The legend: species, rattlers, widths of forces; centred `bottom` inches up."""
  packing, flat = view.packing, view.d == 2
  text = dict(size=size, color=INK)
  height = 16
  rattler = MarkedRattlers(packing, contacts)

  def Sample(width, *artists):
    area = DrawingArea(width, height)
    for artist in artists:
      area.add_artist(artist)
    return area

  def Row(*children, sep=5):
    return HPacker(children=[TextArea(child, textprops=text)
                             if isinstance(child, str) else child
                             for child in children], align="center", pad=0, sep=sep)

  def Disc(radius, **style):
    return Sample(2 * radius, Circle((radius, height / 2), radius, linewidth=0.8,
                                     **style))

  grains, forces = [], []
  names, species = packing.species
  fills = SPECIES_FILLS if flat else SPECIES_NODES
  means = [np.mean(packing.radii[species == k]) for k in range(len(names))]
  if len(names) <= len(fills):
    for name, fill, mean in zip(names, fills, means):
      grains.append(Row(Disc(8 * mean / max(means), facecolor=fill,
                             edgecolor=Mix(fill, INK, 0.45)),
                        name.replace("$", r"\$")))
  if rattler.any():
    hatched = flat and np.mean(packing.radii) * view.points > HATCH_ABOVE
    grains.append(Row(Disc(7, facecolor="white", edgecolor=GREY if flat else INK,
                           hatch="////" if hatched else None), "rattler"))
  if contacts is not None and np.any(contacts.force > 0):
    clipped = contacts.force.max() > MAX_FORCE * MeanForce(contacts)
    forces.append(r"$f\,/\langle f\rangle$ :")
    for strength in (0.5, 1, 2, MAX_FORCE if clipped else 4):
      colour = ForceColour(strength) if flat else Fogged(STRONG, 0.85)
      line = Line2D([0, 24], [height / 2] * 2, color=colour,
                    linewidth=strength * view.unit_width, solid_capstyle="butt")
      forces.append(Row(Sample(24, line), (r"$\geq %g$" if strength == MAX_FORCE
                                           else "$%g$") % strength))
  rows = [Row(*grains, Row(*forces, sep=9), sep=20)]
  if not flat:
    steps = 24
    shades = [Rectangle((3 * k, height / 2 - 5), 3.1, 10, linewidth=0,
                        facecolor=Fogged(STRONG, k / (steps - 1)))
              for k in range(steps)]
    rows.append(Row("projection along z, spheres reduced:   back", Sample(3 * steps, *shades), "front"))
  figure.add_artist(AnchoredOffsetbox(
      "center", child=VPacker(children=rows, align="center", pad=0, sep=5), pad=0,
      frameon=False, bbox_to_anchor=(0.5, bottom / figure.get_size_inches()[1]),
      bbox_transform=figure.transFigure))


def Label(figure, x, y, text, width, **style):
  """Text at inches (x, y), made smaller if wider than `width` inches."""
  total = figure.get_size_inches()
  label = figure.text(x / total[0], y / total[1], text, va="center", **style)
  extent = label.get_window_extent(figure.canvas.get_renderer()).width / figure.dpi
  if extent > width:
    label.set_fontsize(label.get_fontsize() * width / extent)


def Space(packing, side):
  """Height of a space `side` wide that suits the cell, and of the key below it."""
  spans = np.abs(packing.cell[:, :2]).sum(axis=0)
  return min(1.3, spans[1] / spans[0]) * side, 0.5 if len(packing.cell) == 2 else 0.78


def PackingFigure(arguments):
  packing = ReadPacking(arguments.packing)
  contacts = ReadContacts(arguments.contacts, packing)
  width, side = 6.6, 6.4
  height, foot = Space(packing, side)
  head = 0.76 if arguments.title else 0.42
  figure = plt.figure(figsize=(width, height + head + foot))
  view = View(figure, packing, 0.1, foot, side, height)
  Draw(view, contacts)
  Label(figure, width / 2, foot + height + 0.18,
        "     ".join(Describe(packing, contacts)), side, ha="center", fontsize=12.5)
  if arguments.title:
    Label(figure, width / 2, foot + height + 0.53, arguments.title.replace("$", r"\$"),
          side, ha="center", fontsize=15, fontweight="bold")
  Key(figure, view, contacts, foot / 2)
  return figure


# In mean radii: of the mean square over grains that move, and at most.
MEAN_ARROW, LONGEST_ARROW = 1.3, 4.5


def DrawArrows(view, vectors):
  """Arrows from the centres."""
  packing = view.packing
  length = np.linalg.norm(vectors, axis=1)
  radius = np.mean(packing.radii)
  typical = math.sqrt(np.mean(length[length > 0]**2))
  arrows = vectors * radius * min(LONGEST_ARROW / length.max(), MEAN_ARROW / typical)
  # Shorter ones would be dots.
  shown = np.nonzero(length > 0.02 * length.max())[0]
  start = view.fractions[shown]
  if view.d == 2:
    end = start + arrows[shown] @ view.inverse
    which, shifts = view.Copies(np.minimum(start, end), np.maximum(start, end))
    start, shown = start[which] + shifts, shown[which]
  points = (start @ packing.cell)[:, :2]
  width = min(0.16 * radius * view.points, 2.0)
  colour = Mix(BLUE, INK, 0.25)
  if view.d == 3:
    colour = [Fogged(colour, depth / DEPTHS) for depth in Depth(start)]
  return view.ax.quiver(
      points[:, 0], points[:, 1], arrows[shown, 0], arrows[shown, 1],
      angles="xy", scale_units="xy", scale=1, units="inches", width=width / 72,
      headwidth=4, headlength=4.5, headaxislength=4, minlength=0.5,
      color=colour, zorder=2 if view.d == 2 else 2 + DEPTHS + 1)


def ModeFigure(arguments):
  packing = ReadPacking(arguments.packing)
  contacts = ReadContacts(arguments.contacts, packing)
  table = ReadTable(arguments.table,
                    ("mode", "relative_eigenvalue", "participation", "half"))
  row = np.nonzero(table["mode"] == arguments.number)[0]
  if len(row) == 0:
    raise InputError("%s: no mode %d" % (arguments.table, arguments.number))
  row = row[0]
  vectors = ReadVectors(arguments.packing, "mode_%d" % arguments.number, packing)
  width, side = 6.6, 6.4
  height, foot = Space(packing, side)
  figure = plt.figure(figsize=(width, height + 0.76 + foot))
  view = View(figure, packing, 0.1, foot, side, height)
  if view.d == 2:
    DrawFlat(view, contacts, lambda: [DrawArrows(view, vectors)])
  else:
    DrawProjection(view, contacts._replace(force=0 * contacts.force))
    DrawArrows(view, vectors)
  words = [r"$\lambda_{%d} = %s\,\kappa$" %
           (arguments.number, Scientific(table["relative_eigenvalue"][row])),
           "participation $%.2g$" % table["participation"][row],
           "half of it on %d of %d grains" %
           (table["half"][row], np.sum(~Rattlers(packing, contacts)))]
  Label(figure, width / 2, foot + height + 0.48, "     ".join(words), side, ha="center",
        fontsize=13.5)
  Label(figure, width / 2, foot + height + 0.18,
        "     ".join(Describe(packing, contacts)), side, ha="center", fontsize=11.5)
  Key(figure, view, contacts._replace(force=0 * contacts.force), foot / 2)
  return figure


def StagesFigure(arguments):
  files = ("stage_initial.xyz", "stage_unjammed.xyz", "packing.xyz", "contacts.csv")
  files = [os.path.join(arguments.directory, file) for file in files]
  packings = [ReadPacking(file) for file in files[:3]]
  contacts = ReadContacts(files[3], packings[2])
  side, gap, head = 4.1, 0.2, 0.74
  height, foot = Space(packings[2], side)
  figure = plt.figure(figsize=(3 * side + 4 * gap, height + head + foot))
  border = None
  for k in (2, 0, 1):
    packing, shown = packings[k], contacts if k == 2 else None
    left = gap + k * (side + gap)
    view = View(figure, packing, left, foot, side, height, border)
    Draw(view, shown)
    if k == 2:
      border = view.border
      Key(figure, view, contacts, foot / 2, size=14)
    top = foot + height
    Label(figure, left, top + 0.52, "abc"[k], side, fontsize=18, fontweight="bold")
    Label(figure, left + 0.3, top + 0.52, ("initial", "last unjammed", "jammed")[k],
          side, fontsize=16)
    words = Describe(packing, shown)
    Label(figure, left, top + 0.19,
          "    ".join(words[1:2] if k < 2 else words[1:2] + words[3:]), side,
          fontsize=14)
  return figure


# ---------------------------------------------------------------- curves


def Decades(axis, low, high, zero=None):
  """Ticks at powers of ten, five at most, and `0` at `zero`."""
  ends = low, high
  low, high = math.ceil(low - 1e-9), math.floor(high + 1e-9)
  step = max(1, math.ceil((high - low + 1) / 5))
  exponents = [e for e in range(low, high + 1) if (e - high) % step == 0]
  ticks = [10.0**e for e in exponents]
  labels = [r"$10^{%d}$" % e for e in exponents]
  if zero is not None:
    ticks.insert(0, zero)
    labels.insert(0, "$0$")
  axis.set_major_locator(ticker.FixedLocator(ticks))
  axis.set_major_formatter(ticker.FixedFormatter(labels))
  minor = ([10.0**e for e in range(low, high + 1) if e not in exponents] if step > 1
           else [m * 10.0**e for e in range(low - 1, high + 1) for m in range(2, 10)])
  axis.set_minor_locator(ticker.FixedLocator(
      [tick for tick in minor if ends[0] <= math.log10(tick) <= ends[1]]))
  axis.set_minor_formatter(ticker.NullFormatter())


def Span(values):
  """Decades around positive values, with air and at least one power of ten."""
  if not len(values):
    return -0.4, 0.4
  low, high = math.log10(values.min()), math.log10(values.max())
  air = max(0.25, 0.06 * (high - low))
  low, high = low - air, high + air
  if math.floor(high) - math.ceil(low) < 1:
    low, high = math.floor(low + 0.1) - 0.1, math.ceil(high - 0.1) + 0.1
  return low, high


STAGES = (("start", PURPLE, "D"), ("growth", BLUE, "o"), ("bisection", ORANGE, "s"),
          ("decompression", GREEN, "^"))


def Scatter(ax, x, y, table, size=42):
  """Filled markers for jammed, open for unjammed, grey-filled for undecided."""
  stage, verdict = np.array(table["stage"]), np.array(table["verdict"])
  for name, colour, marker in STAGES:
    for kind, fill in (("unjammed", "white"), ("undecided", PALE), ("jammed", colour)):
      chosen = (stage == name) & (verdict == kind) & np.isfinite(x) & np.isfinite(y)
      if chosen.any():
        ax.scatter(x[chosen], y[chosen], s=size, marker=marker, facecolor=fill,
                   edgecolor=Mix(colour, INK, 0.25), linewidth=1.0, zorder=4,
                   clip_on=False)


def Guide(ax, x, y, slope, floor):
  """A line of that slope below the points, above 10^floor, over three decades."""
  x, y = np.log10(x), np.log10(y)
  low, high = max(x.min(), x.max() - 3), x.max()
  shift = np.min((y - slope * x)[x >= low]) - 0.05 * np.ptp(np.log10(ax.get_ylim()))
  if slope > 0:
    low = max(low, (floor - shift) / slope)
  if high - low < 0.5:
    return
  ends = np.array([low, high])
  ax.plot(10**ends, 10**(slope * ends + shift), color=GREY, linewidth=1.2,
          linestyle=(0, (5, 3)), zorder=2)
  middle = 0.4 * low + 0.6 * high
  ax.annotate("slope %g" % slope, (10**middle, 10**(slope * middle + shift)),
              xytext=(8, -10), textcoords="offset points", ha="left", va="top",
              color=GREY)


def PathFigure(arguments):
  names = ("stage", "phi", "energy", "pressure", "coordination", "rigid_grains",
           "verdict")
  table = ReadTable(arguments.table, names, words=("stage", "verdict"))
  if not len(table["phi"]) or not np.isfinite(table["phi"]).all():
    raise InputError("%s: no rows, or a phi that is not finite" % arguments.table)
  for name, known in (("stage", [s[0] for s in STAGES]),
                      ("verdict", ["jammed", "unjammed", "undecided"])):
    for line, word in enumerate(table[name], 2):
      if word not in known:
        raise InputError("%s:%d: %s %r is none of %s" %
                         (arguments.table, line, name, word, ", ".join(known)))
  phi, phi_j, d = table["phi"], arguments.phi_j, arguments.dimension
  jammed = np.array(table["verdict"]) == "jammed"
  excess = np.full(len(phi), np.nan)
  if phi_j is not None:
    # phi_J is that of the decompressed branch, if there is one.
    beyond = jammed & (phi > phi_j)
    branch = beyond & (np.array(table["stage"]) == "decompression")
    beyond = branch if branch.sum() > 1 else beyond
    excess[beyond] = phi[beyond] - phi_j
  zoom = np.isfinite(excess).any()

  figure, axes = plt.subplots(
      3, 2 if zoom else 1, squeeze=False, sharex="col",
      figsize=(11.0 if zoom else 6.6, 8.4),
      gridspec_kw=dict(left=0.09 if zoom else 0.15, right=0.93 if zoom else 0.96,
                       top=0.925 if zoom else 0.91, bottom=0.08, wspace=0.05,
                       hspace=0.08))
  floors = []
  for row, (name, label) in enumerate((("energy", "energy  $E$"),
                                       ("pressure", "pressure  $p$"))):
    values = table[name]
    positive = np.isfinite(values) & (values > 0)
    low, high = Span(values[positive])
    floors.append(low)
    strip = 0.17 * (high - low)  # for zeros
    zero = 10**(low - strip / 2)
    shown = np.where(positive, values, np.where(values == 0, zero, np.nan))
    for column, x in enumerate((phi, excess)[:2 if zoom else 1]):
      ax = axes[row, column]
      ax.set_yscale("log")
      bottom = low - strip if (values == 0).any() else low
      ax.set_ylim(10**bottom, 10**high)
      Decades(ax.yaxis, low, high, zero if (values == 0).any() else None)
      if not positive.any():  # nothing to give the decades a meaning
        ax.yaxis.set_major_locator(ticker.FixedLocator([zero]))
        ax.yaxis.set_major_formatter(ticker.FixedFormatter(["$0$"]))
        ax.yaxis.set_minor_locator(ticker.NullLocator())
      if (values == 0).any():
        ax.axhspan(10**bottom, 10**low, facecolor="#F1F3F5", linewidth=0, zorder=0)
        ax.axhline(10**low, color=GREY, linewidth=0.7, zorder=1)
      Scatter(ax, x, shown, table)
    axes[row, 0].set_ylabel(label)
  z = table["coordination"]
  finite = z[np.isfinite(z)]
  axes[2, 0].set_ylabel("coordination  $z$")
  axes[2, 0].set_ylim(-0.35, max(1.0, finite.max(initial=0.0)) * 1.12)
  axes[2, 0].yaxis.set_major_locator(
      ticker.MaxNLocator(5, steps=[1, 2, 5, 10], integer=True))
  Scatter(axes[2, 0], phi, z, table)
  axes[2, 0].set_xlabel(r"packing fraction  $\phi$")
  axes[2, 0].xaxis.set_major_locator(ticker.MaxNLocator(6, steps=[1, 2, 5, 10]))
  axes[2, 0].margins(x=0.06)
  if phi_j is not None:
    for row in range(3):
      axes[row, 0].axvline(phi_j, color=GREY, linewidth=1.0, linestyle=(0, (5, 3)),
                           zorder=1)
    left = phi_j > np.mean(axes[2, 0].get_xlim())
    axes[2, 0].annotate(r"$\phi_J = %.6f$" % phi_j, (phi_j, 0.5),
                        xycoords=("data", "axes fraction"),
                        xytext=(-8 if left else 8, 0), textcoords="offset points",
                        ha="right" if left else "left", va="center", color=INK)

  if zoom:
    chosen = np.isfinite(excess)
    low, high = Span(excess[chosen])
    for row, name, slope in ((0, "energy", arguments.alpha),
                             (1, "pressure", arguments.alpha - 1)):
      ax = axes[row, 1]
      ax.set_xscale("log")
      ax.set_xlim(10**low, 10**high)
      ax.tick_params(labelleft=False)
      good = chosen & (table[name] > 0)
      if good.any():
        Guide(ax, excess[good], table[name][good], slope, floors[row])
    ax = axes[2, 1]
    Decades(ax.xaxis, low, high)
    ax.set_xlabel(r"distance to jamming  $\phi - \phi_J$")
    ax.yaxis.tick_right()
    ax.yaxis.set_ticks_position("both")
    ax.tick_params(labelleft=False, labelright=True)
    Scatter(ax, excess, z, table)
    nearest = np.nanargmin(excess)
    grains = table["rigid_grains"][nearest]
    if grains > 0:
      # d N' - d + 1 contacts.
      isostatic = 2 * d - 2 * (d - 1) / grains
      ax.axhline(isostatic, color=GREY, linewidth=1.2, linestyle=(0, (5, 3)), zorder=2)
      values = np.append(z[chosen & np.isfinite(z)], isostatic)
      air = max(0.02, 0.12 * np.ptp(values))
      ax.set_ylim(values.min() - 2.0 * air, values.max() + air)
      ax.annotate(r"isostatic  $%d - %d/N' = %.4f$" % (2 * d, 2 * (d - 1), isostatic),
                  (0.97, isostatic), xycoords=("axes fraction", "data"),
                  xytext=(0, -8), textcoords="offset points", ha="right", va="top",
                  color=GREY)
    ax.yaxis.set_major_locator(ticker.MaxNLocator(5, steps=[1, 2, 5, 10]))

  handles = [Line2D([], [], linestyle="", marker=marker, markersize=8,
                    markerfacecolor=colour, markeredgecolor=Mix(colour, INK, 0.25),
                    label=name)
             for name, colour, marker in STAGES if name in table["stage"]]
  for verdict, fill in (("unjammed", "white"), ("undecided", PALE)):
    if verdict in table["verdict"]:
      handles.append(Line2D([], [], linestyle="", marker="o", markersize=8,
                            markerfacecolor=fill, markeredgecolor=INK, label=verdict))
  figure.legend(handles=handles, loc="upper center", ncol=6 if zoom else 3,
                bbox_to_anchor=(0.51 if zoom else 0.555, 0.997), fontsize=13,
                handletextpad=0.2, columnspacing=1.4)
  for ax in axes.flat:
    ax.tick_params(which="both", top=True, right=True)
  figure.align_ylabels(axes[:, 0])
  return figure


def TraceFigure(arguments):
  table = ReadTable(arguments.table, ("iteration", "energy", "max_gradient",
                                      "mean_force", "vanishing", "seconds"))
  if not len(table["energy"]):
    raise InputError("%s: no rows" % arguments.table)
  scale = table["mean_force"]
  residual = np.full(len(scale), np.nan)
  np.divide(table["max_gradient"], scale, out=residual, where=scale > 0)
  curves = [(r"$\max|g|\,/\,\langle f\rangle$", BLUE, "-", residual)]
  # A run that ends unjammed has no small residual, but its forces vanish: their
  # measure is shown if it fell further.
  vanishing = table["vanishing"]
  gone = table["energy"][-1] == 0
  if gone or vanishing[-1] * residual[0] < residual[-1] * vanishing[0]:
    curves.append((r"$(p\,/\,k\,\bar r^{\,\alpha-d})^{1/(\alpha-1)}$", VERMILION,
                   (0, (5, 2)), vanishing))
  for _, _, _, values in curves:
    values[~(np.isfinite(values) & (values > 0))] = np.nan
  curves = [curve for curve in curves if np.isfinite(curve[3]).any()]
  if not curves and not gone:
    raise InputError("%s: no positive residual" % arguments.table)
  shown = np.concatenate([np.array([])] + [values for _, _, _, values in curves])
  shown = shown[np.isfinite(shown)]
  figure, axes = plt.subplots(
      1, 2, sharey=True, figsize=(10.4, 4.4),
      gridspec_kw=dict(left=0.095, right=0.975, top=0.95, bottom=0.16, wspace=0.07))
  low, high = Span(shown)
  axes[0].set_yscale("log")
  axes[0].set_ylim(10**low, 10**high)
  Decades(axes[0].yaxis, low, high)
  seconds = table["seconds"]
  short = seconds.max() < 1
  for ax, x, label in ((axes[0], table["iteration"], "iterations"),
                       (axes[1], seconds * (1000 if short else 1),
                        "milliseconds" if short else "seconds")):
    for name, colour, dashes, values in curves:
      good = np.nonzero(np.isfinite(values))[0]
      ax.plot(x, values, color=colour, linestyle=dashes, label=name,
              linewidth=1.4 if len(good) < 5000 else 0.9,
              marker="o" if len(good) <= 40 else None, markersize=4)
      ax.plot(x[good[-1:]], values[good[-1:]], "o", color=colour, markersize=7,
              clip_on=False, zorder=4)
    if gone:
      ax.plot(x[-1:], [0.03], "o", markerfacecolor="white", markeredgecolor=INK,
              markersize=8, zorder=5, label="$E = 0$", linestyle="",
              transform=ax.get_xaxis_transform())
    ax.set_xlabel(label)
    ax.margins(x=0.03)
    ax.xaxis.set_major_locator(ticker.MaxNLocator(6, steps=[1, 2, 5, 10])
                               if np.ptp(x) > 0 else ticker.FixedLocator(x[:1]))
    ax.xaxis.set_major_formatter(ticker.FuncFormatter(
        lambda value, _: "{:,.10g}".format(value)))
    ax.grid(True, which="major", color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)
  if len(curves) == 1 and not gone:
    axes[0].set_ylabel(curves[0][0])
  else:
    axes[0].set_ylabel("residual")
    axes[1].legend(loc="best", fontsize=13, frameon=True, framealpha=0.9,
                   edgecolor="none")
  return figure


# ---------------------------------------------------------------- comparisons


METHOD_COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, INK, "#56B4E9", GREY)
METHOD_DASHES = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
METHOD_MARKERS = "os^Dv<>p"


def MethodStyles(names):
  """Colour, dashes and marker of each method, in the order of the table."""
  return {name: (METHOD_COLOURS[k % 8], METHOD_DASHES[k % 4 if len(names) <= 8 else
                                                      (k + k // 8) % 4],
                 METHOD_MARKERS[k % 8])
          for k, name in enumerate(names)}


def Unique(words):
  return list(dict.fromkeys(words))


def Levels(arguments):
  """[(is absolute, value)] of --level, none of them: relative."""
  levels = []
  for text in arguments.level:
    kind, _, value = text.partition(":")
    try:
      levels.append((kind == "absolute", float(value)))
    except ValueError:
      value = ""
    if kind not in ("absolute", "relative") or not value or levels[-1][1] <= 0:
      raise InputError("--level=%s must be relative:NUMBER or absolute:NUMBER" % text)
  return levels or [(False, None)]


def ChosenCases(arguments, table, path):
  known = Unique(table["case"])
  chosen = arguments.cases.split(";") if arguments.cases else known
  for case in chosen:
    if case not in known:
      raise InputError("%s: no rows of the case %r" % (path, case))
  return chosen


def CaseTitle(case):
  """`near_jamming=1e-6 at 1e-3` in words."""
  name, _, value = case.partition("=")
  value, _, distance = value.partition(" at ")
  def Power(text):
    mantissa, _, exponent = text.partition("e")
    if not exponent:
      return text
    return ("" if mantissa == "1" else mantissa + r"\times") + "10^{%s}" % exponent
  title = name.replace("_", " ")
  if name in ("growth", "fig2"):
    title = r"growth of radii by $1 + %s$" % Power(value)
  elif name in ("simple_shear", "pure_shear"):
    title = r"%s $\gamma = %s$" % (title, Power(value))
  elif name == "random":
    title = r"random displacements up to $%s\,L$" % Power(value)
  elif name == "near_jamming":
    strain = value[:-1] + r"\,\Delta\phi" if value.endswith("x") else Power(value)
    title = r"shear $\gamma = %s$ at $\Delta\phi = \phi - \phi_J = %s$" % (
        strain, Power(distance))
  elif name == "start":
    title = "random start"
  elif name == "user":
    title = "the input"
  return title


def ResidualLabel(absolute):
  return (r"$\max|g|\,/\,kL^{\alpha-1}$" if absolute
          else r"$\max|g|\,/\,\langle f\rangle$")


def ComparisonAxes(rows):
  """Rows of two panels that share their residuals, and room for a legend."""
  height = 0.95 + 3.55 * rows
  figure, axes = plt.subplots(
      rows, 2, sharey="row", squeeze=False, figsize=(11.0, height),
      gridspec_kw=dict(left=0.095, right=0.98, top=1 - 0.9 / height,
                       bottom=0.68 / height, wspace=0.09, hspace=0.36))
  return figure, axes


def Extend(figure, above=0.0, below=0.0):
  """Adds inches to the figure; the axes keep their size and their distances."""
  width, height = figure.get_size_inches()
  total = height + above + below
  figure.set_size_inches(width, total)
  for grid in {ax.get_subplotspec().get_gridspec() for ax in figure.axes}:
    now = grid.get_subplot_params(figure)
    grid.update(top=(now.top * height + below) / total,
                bottom=(now.bottom * height + below) / total)


def MethodLegend(figure, styles, **properties):
  """Above everything, in as many lines as it takes."""
  names = list(styles)
  room = 9 * figure.get_size_inches()[0]  # in characters
  columns = max([k for k in range(1, len(names) + 1) if k == 1 or sum(
      max(len(name) for name in names[c::k]) + 7 for c in range(k)) <= room])
  handles = [Line2D([], [], color=colour, linestyle=dashes, linewidth=2.4,
                    marker=marker if properties.get("markers") else None,
                    markersize=6, label=name.replace("$", r"\$"))
             for name, (colour, dashes, marker) in styles.items()]
  lines = -(-len(names) // columns)
  Extend(figure, above=0.27 * max(0, lines - 1))
  figure.legend(handles=handles, loc="upper center", ncol=columns,
                bbox_to_anchor=(0.535, 1.0), fontsize=12.5, handlelength=2.4,
                columnspacing=1.5, borderaxespad=0.3)


def TimeUnit(seconds):
  """A factor and its name for times up to `seconds`."""
  if seconds < 1e-3:
    return 1e6, "CPU time / \u00b5s"
  return (1e3, "CPU time / ms") if seconds < 1 else (1.0, "CPU time / s")


def WorkAxis(ax, low, high, log):
  """Plain numbers, or decades if `log`."""
  if log:
    ax.set_xscale("log")
    ends = Span(np.array([low, high]))
    ax.set_xlim(10**ends[0], 10**ends[1])
    Decades(ax.xaxis, *ends)
  else:
    ax.set_xlim(-0.03 * high if high > 0 else -1, 1.04 * high if high > 0 else 1)
    ax.xaxis.set_major_locator(ticker.MaxNLocator(6, steps=[1, 2, 5, 10]))
    ax.xaxis.set_major_formatter(ticker.FuncFormatter(
        lambda value, _: "{:,.10g}".format(value)))


def LevelLines(ax, levels, absolute):
  for kind, value in levels:
    if value is not None and kind == absolute:
      ax.axhline(value, color=GREY, linewidth=1.0, linestyle=(0, (2, 2)), zorder=1)


def FinishPanels(axes):
  for ax in axes.flat:
    ax.grid(True, which="major", color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)


def CurvesFigure(arguments):
  """Thin: the residual, its least and largest values in each part of the run.
  Bold: the least residual so far. A dot is where a run got to the first level, an
  open one at the bottom where it got to E = 0, a cross where it ended otherwise."""
  path = arguments.table
  table = ReadTable(path, ("case", "seed", "solver", "iteration", "cpu_seconds",
                           "residual", "max_gradient"), words=("case", "solver"))
  if not table["case"]:
    raise InputError("%s: no rows" % path)
  levels = Levels(arguments)
  absolute = levels[0][0]
  cases = ChosenCases(arguments, table, path)
  case, solver = np.array(table["case"]), np.array(table["solver"])
  residuals = table["max_gradient" if absolute else "residual"]
  styles = MethodStyles(Unique(table["solver"]))
  figure, axes = ComparisonAxes(len(cases))
  seeds = len(np.unique(table["seed"]))
  any_gone = False
  for row, name in enumerate(cases):
    of_case = case == name
    seed = table["seed"][of_case][0]
    curves, gone = [], {}
    for method in styles:
      chosen = of_case & (solver == method) & (table["seed"] == seed)
      good = np.isfinite(residuals[chosen]) & (residuals[chosen] > 0)
      if good.any():
        curves.append((method, residuals[chosen][good],
                       table["iteration"][chosen][good],
                       table["cpu_seconds"][chosen][good]))
        # Without forces in the end: a dot at the bottom.
        last = np.nonzero(chosen)[0][-1]
        if residuals[last] == 0:
          gone[method] = table["iteration"][last], table["cpu_seconds"][last]
    shown = np.concatenate([np.array([])] + [curve[1] for curve in curves])
    shown = np.append(shown, [value for kind, value in levels
                              if kind == absolute and value is not None])
    low, high = Span(shown)
    axes[row, 0].set_yscale("log")
    axes[row, 0].set_ylim(10**low, 10**high)
    Decades(axes[row, 0].yaxis, low, high)
    ends_of = [np.array([curve[2 + column][-1] for curve in curves])
               for column in range(2)]
    # A method that takes a twentieth of another's work is seen only so.
    log = len(curves) > 1 and all(ends.min() > 0 for ends in ends_of) and any(
        ends.max() > 20 * ends.min() for ends in ends_of)
    for column, ax in enumerate(axes[row]):
      ends = ends_of[column]
      factor, label = (1.0, "iterations")
      if column == 1:
        factor, label = TimeUnit(ends.max(initial=0.0))
      first = 1.0 if column == 0 else 1e-3 * ends.min(initial=np.inf) * factor
      for method, values, *work in curves:
        colour, dashes, _ = styles[method]
        x = work[column] * factor
        if log:
          x = np.maximum(x, first)
        ax.plot(x, values, color=colour, linewidth=0.6, alpha=0.45, zorder=2)
        ax.plot(x, np.minimum.accumulate(values), color=colour, linestyle=dashes,
                linewidth=1.9, zorder=3)
        least = values.min()
        if method in gone:
          x = np.array([x[-1], max(gone[method][column] * factor, first)])
          ax.plot(x, [least, 10**low], color=colour, linestyle=dashes, linewidth=1.9,
                  zorder=3)
          ax.plot(x[1:], [10**low], "o", markerfacecolor="white", clip_on=False,
                  markeredgecolor=colour, markeredgewidth=1.8, markersize=8, zorder=5)
          any_gone = True
          continue
        failed = any(kind == absolute and value is not None and least > value
                     for kind, value in levels[:1])
        ax.plot(x[-1:], [least], "X" if failed else "o", color=colour,
                markeredgecolor=INK if failed else colour, clip_on=False,
                markersize=10 if failed else 7, zorder=5 if failed else 4)
      WorkAxis(ax, first, ends.max() * factor if len(ends) else 1.0, log)
      LevelLines(ax, levels, absolute)
      ax.set_xlabel(label)
    axes[row, 0].set_ylabel(ResidualLabel(absolute))
    axes[row, 0].set_title(
        CaseTitle(name) + (", seed %d of %d" % (seed, seeds) if seeds > 1 else ""),
        loc="left", pad=7)
  FinishPanels(axes)
  figure.align_ylabels(axes[:, 0])
  axes[0, 1].set_title("bold: least so far; thin: as it comes" +
                       ("; open dot: $E = 0$" if any_gone else ""), loc="right", pad=7,
                       fontsize=11, color=GREY)
  MethodLegend(figure, styles)
  Help(figure, *CURVES_HELP)
  return figure


def QuantilesOf(values):
  """20, 50 and 80 % of values of which some may be infinite."""
  values, result = np.sort(values), []
  for fraction in (0.2, 0.5, 0.8):
    place = fraction * (len(values) - 1)
    below = int(place)
    weight = place - below
    if weight < 1e-9:
      result.append(values[below])
    elif math.isinf(values[below + 1]):
      result.append(math.inf)
    else:
      result.append(values[below] + weight * (values[below + 1] - values[below]))
  return result


def WorkFigure(arguments):
  """Medians over seeds, steps and repetitions, bands of 20 to 80 %; a run that never
  got to a residual counts as infinitely expensive, so curves end where half of them
  failed."""
  path = arguments.table
  table = ReadTable(path, ("case", "seed", "repetition", "solver", "kind", "level",
                           "evaluations", "cpu_seconds"),
                    words=("case", "solver", "kind"), optional=("step",))
  if not table["case"]:
    raise InputError("%s: no rows" % path)
  levels = Levels(arguments)
  absolute = levels[0][0]
  cases = ChosenCases(arguments, table, path)
  styles = MethodStyles(Unique(table["solver"]))
  case, solver = np.array(table["case"]), np.array(table["solver"])
  of_kind = np.array(table["kind"]) == ("absolute" if absolute else "relative")
  figure, axes = ComparisonAxes(len(cases))
  for row, name in enumerate(cases):
    of_case = case == name
    runs = len(set(zip(*(table[key][of_case] for key in ("seed", "step", "repetition")
                         if key in table))))
    curves = []
    for method in styles:
      chosen = of_case & (solver == method) & of_kind
      curve = []
      for level in sorted(set(table["level"][chosen]), reverse=True):
        here = chosen & (table["level"] == level)
        missing = np.full(max(0, runs - here.sum()), np.inf)
        curve.append([level] + [QuantilesOf(np.append(table[what][here], missing))
                                for what in ("evaluations", "cpu_seconds")])
      curve = [point for point in curve if math.isfinite(point[1][1])]
      if curve:
        curves.append((method, np.array([point[0] for point in curve]),
                       np.array([point[1] for point in curve]),
                       np.array([point[2] for point in curve])))
    # What all have reached at the start says nothing, but for the last of it.
    began = [level for level in curves[0][1] if all(
        (curve[2][curve[1] == level, 1] <= 1).any() for curve in curves)] if curves else []
    curves = [(method, *(part[values <= min(began, default=np.inf)]
                         for part in (values, *work)))
              for method, values, *work in curves]
    shown = np.concatenate([np.array([])] + [curve[1] for curve in curves])
    low, high = Span(shown)
    ax = axes[row, 0]
    ax.set_yscale("log")
    ax.set_ylim(10**low, 10**high)
    Decades(ax.yaxis, low, high)
    for column, ax in enumerate(axes[row]):
      most = max([curve[2 + column][-1, 1] for curve in curves], default=1.0)
      factor, label = (1.0, "evaluations of energy and gradient")
      if column == 1:
        factor, label = TimeUnit(most)
      # What every method has at the start says nothing.
      least = min([curve[2 + column][curve[2 + column][:, 1] > 0, 1].min(initial=most)
                   for curve in curves], default=1.0)
      first = least * factor
      for method, values, *work in curves:
        colour, dashes, marker = styles[method]
        x = np.maximum(work[column] * factor, first)
        x[~np.isfinite(x)] = 10 * most * factor
        ax.fill_betweenx(values, x[:, 0], x[:, 2], color=colour, alpha=0.15,
                         linewidth=0, zorder=2)
        ax.plot(x[:, 1], values, color=colour, linestyle=dashes, linewidth=1.7,
                marker=marker, markersize=5, zorder=3)
      WorkAxis(ax, first, most * factor, True)
      LevelLines(ax, levels, absolute)
      ax.set_xlabel(label)
    axes[row, 0].set_ylabel(ResidualLabel(absolute) + " reached")
    axes[row, 0].set_title(CaseTitle(name), loc="left", pad=7)
  FinishPanels(axes)
  figure.align_ylabels(axes[:, 0])
  axes[0, 1].set_title("medians; bands: 20 to 80 % of the runs", loc="right", pad=7,
                       fontsize=11, color=GREY)
  MethodLegend(figure, styles, markers=True)
  Help(figure, *WORK_HELP)
  return figure


def DistancesFigure(arguments):
  """A column for each strain. Filled: medians over the steps; light: the worst one.
  In the strip above: how many steps failed, a line a method; open: half of them
  did, at what the median one had spent. Lines: least squares of the logarithm of
  the median against that of the distance, over the points of which no step ended
  unjammed; the others are pale."""
  path = arguments.table
  quantities = (("iterations", "iterations", "spent_iterations"),
                ("factorizations", "factorizations", "spent_factorizations"),
                ("CPU time / s", "cpu_seconds", "spent_seconds"))
  numbers = [name for _, *names in quantities for name in
             (names[0], names[0] + "_worst", names[1], names[1] + "_worst")]
  table = ReadTable(path, ("case", "strain", "relative", "asked_distance", "kind",
                           "level", "steps_kind", "solver", "steps", "failed",
                           "unjammed", *numbers),
                    words=("case", "kind", "solver", "steps_kind"))
  absolute, level = Levels(arguments)[0]
  chosen = np.array(table["steps_kind"]) == arguments.steps
  chosen &= np.array(table["kind"]) == ("absolute" if absolute else "relative")
  if level is not None:
    chosen &= np.isclose(table["level"], level, rtol=1e-9, atol=0)
  if not chosen.any():
    raise InputError("%s: no rows of such steps at that level" % path)
  table = {name: (np.array(column) if isinstance(column, list) else column)[chosen]
           for name, column in table.items()}
  quantities = [quantity for quantity in quantities
                if (table[quantity[2] + "_worst"] > 0).any()]
  strains = Unique(zip(table["relative"], table["strain"]))
  styles = MethodStyles(Unique(table["solver"]))
  x_low, x_high = Span(table["asked_distance"])
  rows, columns = len(quantities), len(strains)
  width, height = 0.85 + 5.4 * columns, 1.55 + 2.95 * rows
  figure, axes = plt.subplots(
      rows, columns, sharex=True, sharey="row", squeeze=False, figsize=(width, height),
      gridspec_kw=dict(left=0.85 / width, right=1 - 1.4 / width,
                       top=1 - 0.85 / height, bottom=0.95 / height,
                       wspace=1.4 / 4.0, hspace=0.1))
  for row, (label, name, spent) in enumerate(quantities):
    values = np.concatenate([table[key] for key in
                             (name, name + "_worst", spent, spent + "_worst")])
    low, high = Span(values[np.isfinite(values) & (values > 0)])
    # A strip for the failures, in which each method that fails has its own line.
    failing = [method for method in styles if
               ((table["solver"] == method) & (table["failed"] > 0) &
                (table[spent + "_worst"] > 0)).any()]
    strip = 0.02 * (high - low) * (1.5 + 5 * len(failing)) if failing else 0.0
    for column, strain in enumerate(strains):
      ax = axes[row, column]
      here = ((table["relative"] == strain[0]) & (table["strain"] == strain[1]))
      fits = []
      for k, (method, (colour, dashes, marker)) in enumerate(styles.items()):
        mine = np.nonzero(here & (table["solver"] == method))[0]
        # Work of a kind that the method does not do.
        if not (table[spent + "_worst"][mine] > 0).any():
          continue
        distance = table["asked_distance"][mine]
        # Side by side.
        x = distance * 10**(min(0.06, 0.4 / len(styles)) * (k - (len(styles) - 1) / 2))
        y, worst = table[name][mine], table[name + "_worst"][mine]
        good = np.isfinite(y) & (y > 0)
        pale = table["unjammed"][mine] > 0
        failed = table["failed"][mine]
        at = np.where(good, y, table[spent][mine])
        above = (10**(high + strip * (1 - (failing.index(method) + 0.5) / len(failing)))
                 if method in failing else np.inf)
        top = np.where(np.isfinite(worst), worst, above)
        ax.vlines(x, at, top, color=colour, linewidth=0.9, alpha=0.35, zorder=2)
        seen = np.isfinite(worst) & (worst > y)
        ax.plot(x[seen], worst[seen], color=colour, linestyle="", marker=marker,
                markersize=4.5, alpha=0.4, markeredgewidth=0, zorder=3)
        for some, style in ((good & ~pale, {}), (good & pale, {"alpha": 0.45})):
          ax.plot(x[some], y[some], color=colour, linestyle="", marker=marker,
                  markersize=6.5, zorder=4, **style)
        ax.plot(x[~good], at[~good], color=colour, linestyle="", marker=marker,
                markersize=7, markerfacecolor="white", markeredgewidth=1.4, zorder=4)
        for place, count in zip(x[failed > 0], failed[failed > 0]):
          ax.text(place, above, "%d" % count, color=colour, fontsize=10,
                  fontweight="bold", ha="center", va="center", zorder=5,
                  bbox=dict(boxstyle="square,pad=0.1", facecolor=FOG, linewidth=0))
        some = good & ~pale
        text = "\u2013"
        if some.sum() > 2:
          u, v = np.log(distance[some]), np.log(y[some])
          slope, offset = np.polyfit(u, v, 1)
          rest = v - slope * u - offset
          error = math.sqrt(np.sum(rest**2) / (len(u) - 2) / np.sum((u - u.mean())**2))
          ends = np.array([u.min(), u.max()])
          ax.plot(np.exp(ends), np.exp(offset + slope * ends), color=colour,
                  linestyle=dashes, linewidth=1.3, zorder=3)
          text = ("%+.2f \u00b1 %.2f" % (slope, error)).replace("-", "\u2212")
        fits.append((colour, marker, text))
      ax.set_xscale("log")
      ax.set_yscale("log")
      ax.set_xlim(10**x_low, 10**x_high)
      ax.set_ylim(10**low, 10**(high + strip))
      Decades(ax.xaxis, x_low, x_high)
      Decades(ax.yaxis, low, high)
      if failing:
        ax.axhspan(10**high, 10**(high + strip), color=FOG, linewidth=0, zorder=1)
        ax.text(1.02, 1.0 - 0.5 * strip / (high + strip - low), "steps that failed",
                transform=ax.transAxes, fontsize=9.5, color=GREY, ha="left",
                va="center", rotation=0)
      # The exponents, beside the panel.
      line = 0.074
      first = 0.5 + 0.5 * line * len(fits)
      ax.text(1.02, first, r"$\propto \Delta\phi^{\,x}$ with $x =$",
              transform=ax.transAxes, fontsize=10, color=GREY, va="center")
      for k, (colour, marker, text) in enumerate(fits):
        y_text = first - line * (k + 1.1)
        ax.plot([1.045], [y_text], transform=ax.transAxes, color=colour, marker=marker,
                markersize=5, clip_on=False)
        ax.text(1.075, y_text, text, transform=ax.transAxes, fontsize=10.5,
                color=colour, va="center")
      if column == 0:
        ax.set_ylabel(label)
      if row == 0:
        value = "%g" % strain[1]
        if "e" in value or strain[1] < 1e-3:
          mantissa, exponent = ("%e" % strain[1]).split("e")
          value = ("" if float(mantissa) == 1 else "%g" % float(mantissa) +
                   r"\times ") + "10^{%d}" % int(exponent)
        steps = sorted(set(table["steps"][here].astype(int)))
        count = "%d" % steps[0] if len(steps) == 1 else "%d\u2013%d" % (steps[0],
                                                                       steps[-1])
        ax.set_title(r"$\gamma = %s%s$" % (value, r"\,\Delta\phi" if strain[0] else ""),
                     loc="left", pad=7)
        ax.set_title("%s steps at each $\\Delta\\phi$" % count, loc="right", pad=7,
                     fontsize=10.5, color=GREY)
      if row == rows - 1:
        ax.set_xlabel(r"distance to jamming  $\Delta\phi = \phi - \phi_J$")
  words = "filled: medians of %ssteps; small and light: the worst one" % (
      "" if arguments.steps == "all" else arguments.steps + " ")
  if (table["unjammed"] > 0).any():
    words += "; pale, not in the fits: some end unjammed"
  if not np.isfinite(table["iterations"]).all():
    words += "; open: half of them fail"
  FinishPanels(axes)
  figure.align_ylabels(axes[:, 0])
  MethodLegend(figure, styles, markers=True)
  below = Help(figure, *DISTANCES_HELP)
  # In two lines where one is too short.
  figure.text(0.5, (below + 0.08) / figure.get_figheight(),
              words if columns > 1 else words.replace("; ", "\n", 1),
              ha="center", va="bottom", color=GREY, fontsize=10.5)
  return figure


def Fig7Figure(arguments):
  path = arguments.table
  panels = (("iterations", "iterations"), ("seconds", "CPU time / s"))
  numbers = [name + end for name, _ in panels for end in ("_mean", "_deviation")]
  table = ReadTable(path, ("asked_distance", "kind", "level", "steps_kind", "solver",
                           "steps", "failed", *numbers),
                    words=("kind", "solver", "steps_kind"))
  absolute, level = Levels(arguments)[0]
  chosen = np.array(table["steps_kind"]) == "all"
  chosen &= np.array(table["kind"]) == ("absolute" if absolute else "relative")
  if level is not None:
    chosen &= np.isclose(table["level"], level, rtol=1e-9, atol=0)
  if not chosen.any():
    raise InputError("%s: no rows at that level" % path)
  table = {name: (np.array(column) if isinstance(column, list) else column)[chosen]
           for name, column in table.items()}
  styles = MethodStyles(Unique(table["solver"]))
  width, height = 12.2, 6.4
  figure, axes = plt.subplots(
      1, 2, figsize=(width, height),
      gridspec_kw=dict(left=0.9 / width, right=1 - 0.25 / width, top=1 - 0.75 / height,
                       bottom=1.5 / height, wspace=0.18))
  x_low, x_high = Span(table["asked_distance"])
  for ax, (name, label) in zip(axes, panels):
    ax.set_xscale("log")
    ax.set_yscale("log")
    mean, deviation = table[name + "_mean"], table[name + "_deviation"]
    for k, (method, (colour, dashes, marker)) in enumerate(styles.items()):
      mine = np.nonzero(table["solver"] == method)[0]
      x = table["asked_distance"][mine] * 10**(0.035 * (k - (len(styles) - 1) / 2))
      y, spread = mean[mine], np.nan_to_num(deviation[mine])
      ax.errorbar(x, y, yerr=(np.minimum(spread, 0.9 * y), spread), color=colour,
                  linestyle=dashes, linewidth=1.3, marker=marker, markersize=6.5,
                  elinewidth=1.0, capsize=3, zorder=4)
    low, high = Span(np.concatenate([mean[mean > 0], (mean + np.nan_to_num(deviation))]))
    ax.set_xlim(10**x_low, 10**x_high)
    ax.set_ylim(10**low, 10**high)
    Decades(ax.xaxis, x_low, x_high)
    Decades(ax.yaxis, low, high)
    ax.set_xlabel(r"distance to jamming  $\phi - \phi_J$")
    ax.set_ylabel(label)
  FinishPanels(axes)
  MethodLegend(figure, styles, markers=True)
  failed = int(table["failed"].sum())
  ReadingHelp(figure, "The paper\u2019s Fig. 7: means over %d shear steps at each distance; bars: "
              "standard deviations, over packings and steps, downwards at most to a tenth. The "
              "paper\u2019s own curves, the first two, fall from 10\u00b3\u201310\u2074 iterations at 1e-6 to "
              "hundreds at 1e-2.%s" %
              (table["steps"].max(),
               " %d runs that gave up count with what they spent." % failed
               if failed else ""), left=0.9)
  return figure


def StrainTitle(shear):
  """`1e-6`, `0.3x` in words."""
  if shear.endswith("x"):
    return r"$\gamma = %s\,\Delta\phi$" % shear[:-1]
  mantissa, _, exponent = shear.partition("e")
  if not exponent:
    return r"$\gamma = %s$" % shear
  return r"$\gamma = %s10^{%s}$" % ("" if mantissa == "1" else mantissa + r"\times",
                                   exponent)


def ConditioningFigure(arguments):
  """Above: condition numbers of fresh P and of P from before each shear step, on one
  scale; below: the parts of the contacts that change. Lines: medians over the
  packings; bars: from the least to the largest."""
  path = arguments.table
  table = ReadTable(path, ("distance", "preconditioner", "shear", "found", "condition"),
                    words=("preconditioner", "shear"))
  changes = ReadTable(arguments.changes,
                      ("distance", "shear", "relaxed", "contacts", "deformed_opened",
                       "deformed_closed", "step_opened", "step_closed",
                       "newton_opened", "newton_closed", "newton_first",
                       "predicted_opened", "predicted_closed", "message"),
                      words=("shear", "message"))
  which, label = np.array(table["shear"]), np.array(table["preconditioner"])
  good = (table["found"] > 0) & np.isfinite(table["condition"])
  broken = (table["found"] > 0) & ~np.isfinite(table["condition"])
  if not good.any():
    raise InputError("%s: no condition number is finite" % path)
  styles = MethodStyles(Unique(table["preconditioner"]))
  shears = Unique(changes["shear"])
  x_low, x_high = Span(table["distance"])
  low, high = Span(table["condition"][good])
  low = min(low, -0.3)
  columns = 1 + len(shears)
  width, height = 1.0 + 4.35 * columns, 9.6
  figure = plt.figure(figsize=(width, height))
  grid = figure.add_gridspec(2, columns, left=0.85 / width, right=1 - 0.15 / width,
                             top=1 - 1.0 / height, bottom=0.75 / height, wspace=0.07,
                             hspace=0.26, height_ratios=(1.35, 1.0))
  upper = [figure.add_subplot(grid[0, 0])]
  upper += [figure.add_subplot(grid[0, c], sharey=upper[0]) for c in range(1, columns)]
  strip = 0.07 * (high - low) if broken.any() else 0.0
  for ax, shear in zip(upper, ["-", *shears]):
    for k, (name, (colour, dashes, marker)) in enumerate(styles.items()):
      mine = (which == shear) & (label == name)
      shift = 10**(0.035 * (k - (len(styles) - 1) / 2))
      points = []
      for distance in Unique(table["distance"][mine & good]):
        values = table["condition"][mine & good & (table["distance"] == distance)]
        points.append((distance, np.median(values), values.min(), values.max()))
      if points:
        x, y, least, most = np.array(points).T
        ax.vlines(x * shift, least, most, color=colour, linewidth=1.0, alpha=0.45)
        ax.plot(x * shift, y, color=colour, linestyle=dashes, marker=marker,
                markersize=6, linewidth=1.7)
      bad = Unique(table["distance"][mine & broken])
      ax.plot(np.array(bad) * shift, [10**(high + 0.5 * strip)] * len(bad), color=colour,
              linestyle="", marker=marker, markersize=6, markerfacecolor="white",
              markeredgewidth=1.4, zorder=4)
    if strip:
      ax.axhspan(10**high, 10**(high + strip), color=FOG, linewidth=0, zorder=0)
      if ax is upper[0]:
        ax.text(0.98, 1 - 0.5 * strip / (high + strip - low),
                "not positive definite", color=GREY, fontsize=9.5, ha="right",
                va="center", transform=ax.transAxes)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlim(10**x_low, 10**x_high)
    ax.set_ylim(10**low, 10**(high + strip))
    Decades(ax.xaxis, x_low, x_high)
    Decades(ax.yaxis, low, high)
    ax.axhline(1.0, color=GREY, linewidth=0.8, zorder=1)
    ax.set_title("P is fresh" if shear == "-" else
                 "P from before a step " + StrainTitle(shear), loc="left", pad=7)
    if ax is not upper[0]:
      ax.tick_params(labelleft=False)
  upper[0].set_ylabel(r"condition number of $P^{-1}H$")

  # Parts of the contacts, on a scale that has a zero.
  contacts = changes["contacts"]
  known = np.array([not message for message in changes["message"]])
  relaxed = changes["relaxed"] > 0
  parts = (
      ("met on the way of Newton's first step", INK, "D", (0, (5, 1.5)),
       changes["newton_opened"] + changes["newton_closed"], known),
      ("the affine deformation makes", ORANGE, "^", "-",
       changes["deformed_opened"] + changes["deformed_closed"], contacts > 0),
      ("linear response of the state before predicts", "#56B4E9", "v",
       (0, (6, 1.5, 1.2, 1.5)),
       changes["predicted_opened"] + changes["predicted_closed"],
       changes["predicted_opened"] >= 0),
      ("the whole step, once relaxed", BLUE, "o", "-",
       changes["step_opened"] + changes["step_closed"], relaxed))
  floor = 0.3 / contacts.max()
  lower = [figure.add_subplot(grid[1, c], sharex=upper[c]) for c in range(1, columns)]
  for ax, shear in zip(lower, shears):
    for k, (_, colour, marker, dashes, count, some) in enumerate(parts):
      mine = some & (np.array(changes["shear"]) == shear)
      shift = 10**(0.05 * (k - 1.5))
      points = []
      for distance in Unique(changes["distance"][mine]):
        here = mine & (changes["distance"] == distance)
        part = np.maximum(count[here] / contacts[here], floor)
        points.append((distance, np.median(part), part.min(), part.max()))
      if not points:
        continue
      x, y, least, most = np.array(points).T
      ax.vlines(x * shift, least, most, color=colour, linewidth=1.0, alpha=0.45)
      ax.plot(x * shift, y, color=colour, linestyle=dashes, marker=marker, markersize=6)
    ends = math.log10(floor) - 0.2, math.log10(4.0)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlim(10**x_low, 10**x_high)
    ax.set_ylim(10**ends[0], 10**ends[1])
    Decades(ax.xaxis, x_low, x_high)
    Decades(ax.yaxis, math.log10(floor) + 0.4, 0.0, zero=floor)
    ax.axhspan(10**ends[0], floor * 1.5, color=FOG, linewidth=0, zorder=0)
    ax.set_title("contacts changed, " + StrainTitle(shear), loc="left", pad=7)
    if ax is lower[0]:
      ax.set_ylabel("changes / contacts")
    else:
      ax.tick_params(labelleft=False)
  FinishPanels(np.array([upper + lower], dtype=object))
  for ax in [upper[0], *lower]:
    ax.set_xlabel(r"distance to jamming  $\Delta\phi = \phi - \phi_J$")
  # The free place under the first panel says what is what.
  handles = [Line2D([], [], color=colour, linestyle=dashes, marker=marker, markersize=6,
                    linewidth=1.7, label=name)
             for name, colour, marker, dashes, _, _ in parts]
  place = grid[1, 0].get_position(figure)
  figure.legend(handles=handles, loc="upper left", fontsize=11, handlelength=2.6,
                title="contacts that open or close", alignment="left",
                title_fontsize=12, labelspacing=0.75, borderaxespad=0.0,
                bbox_to_anchor=(place.x0 - 0.045, place.y1 - 0.055))
  MethodLegend(figure, styles, markers=True)
  figure.text(place.x0 - 0.04, 0.2 / height, "lines: medians over packings;\n"
              "bars: least to largest", color=GREY, fontsize=10.5, va="bottom")
  return figure


# ------------------------------------------------- profiles, whole protocols


def Help(figure, *sentences):
  """How to read the figure, below everything, in small type; the axes stay as large
  as they are. The height in inches that it takes."""
  width = figure.get_figwidth()
  lines = textwrap.wrap(" ".join(sentences), int(13.6 * width - 3))
  extra = 0.165 * len(lines) + 0.1
  Extend(figure, below=extra)
  total = figure.get_figheight()
  text = "\n".join(lines)
  for word, symbol in (("\u03c6_cr", r"$\phi_{\mathrm{cr}}$"), ("\u03c6_J", r"$\phi_J$")):
    text = text.replace(word, symbol)
  figure.text(0.14 / width, 0.1 / total, text, ha="left", va="bottom",
              fontsize=9.5, linespacing=1.25, color=GREY)
  return extra


PROFILE_HELP = (
    "At a factor \u03c4 a curve shows on which part of the problems a method got there "
    "with at most \u03c4 times the work of the method that was cheapest on that problem: "
    "at \u03c4 = 1 how often it was the cheapest itself, at the right end how often it got "
    "there at all.",
    "Higher is better, but only beside the best method, since the order of two others may "
    "change when a third is left out; an evaluation may come with a factorization, which "
    "only CPU time knows.")

QUALITY_HELP = {
    "energy": (
        "Left, a curve shows which part of the problems a method ended within that much of "
        "the least energy that any method found, so a curve that stays low on the left has "
        "ended in higher minima or was not done.",
        "Right, how often it ended in the very minimum of the reference, with Wilson's 95 % "
        "interval: costs of methods that end in different minima are not those of one task."),
    "path": (
        "Left, a curve shows at which part of the strains a method's energy is the "
        "reference's to within that much of it; what lies far to the right was sheared "
        "through other rearrangements.",
        "Right, in how many whole runs it stayed with the reference all the way, with "
        "Wilson's 95 % interval, which takes runs as independent: those of one seed at "
        "several tolerances are not."),
    "excess": (
        "Left, a curve shows for which part of the runs the \u03c6_cr that the published "
        "Algorithm 1 returns is at most so many \u03b5 above the \u03c6_J of its own branch; "
        "the algorithm promises 1.",
        "Right, how often \u03c6_cr from the same start is within \u03b5 of the reference's, "
        "with Wilson's 95 % interval, which takes runs as independent: those of one seed at "
        "several tolerances are not."),
}

JAMMING_HELP = (
    "Each mark is one run of the published Algorithm 1 from one seed: left, how far the "
    "state that it returns is above the jamming point of its own branch, which should be "
    "less than \u03b5 (dashed); then what growth and bisection took.",
    "Open marks are runs whose bisection halved an interval with more than one transition: "
    "the branch that it returns is jammed below a state that it called unjammed.")

SHEAR_HELP = (
    "Above, the deviatoric stress under pure shear, each method relaxing its own state after "
    "each increment: as long as the curves are one, the methods answer the same question.",
    "Below, how much the energy differs from the reference's; a jump out of the "
    "rounding is a rearrangement that the two methods took differently, after which they "
    "shear different packings, neither of them wrong, until a fall shows that they have met "
    "again.")

CURVES_HELP = (
    "Each curve is one run, its residual against iterations (left) and CPU time (right); "
    "further down and further left is better.",
    "An iteration of one method costs more than that of another, so only the right side says "
    "who is faster, and that on this machine.")

WORK_HELP = (
    "A curve shows what a method had spent when it first met each residual, so at the "
    "tolerance that one needs the leftmost curve is the cheapest method.",
    "Where curves cross the best method depends on the tolerance; a curve ends where half of "
    "the runs never got further down.")

DISTANCES_HELP = (
    "Each mark is the work of a shear step at one distance from jamming; a method whose marks "
    "stay level does not feel it, one that rises to the left slows down with the exponent "
    "given beside the panel.",
    "A step that failed, of which the strip on top has the number, is infinitely expensive in "
    "the medians, so a method is cheap only where it has none there.")


def RatioTicks(axis, most):
  """1, 2, 5, 10, ... or decades on a logarithmic axis that begins at 1."""
  if most > 300:
    Decades(axis, 0.0, math.log10(most))
    return
  ticks = ([1, 1.2, 1.5, 2, 3, 4] if most <= 5 else
           [m * 10**e for e in range(3) for m in (1, 2, 5)])
  ticks = [tick for tick in ticks if tick <= most]
  axis.set_major_locator(ticker.FixedLocator(ticks))
  axis.set_major_formatter(ticker.FixedFormatter(["%g" % tick for tick in ticks]))
  axis.set_minor_locator(ticker.NullLocator())


def Steps(ax, at, fraction, first, last, style):
  """A distribution from `first` to `last`; values below `first` are there already."""
  colour, dashes, _ = style
  at = np.maximum(at, first)
  x = np.concatenate([[first], at, [last]])
  y = np.concatenate([[0.0], fraction, [fraction[-1] if len(fraction) else 0.0]])
  # Nothing at `first` but what is there.
  here = (at <= first).sum()
  if here:
    x, y = x[here:], y[here:]
  ax.step(x, y, where="post", color=colour, linestyle=dashes, linewidth=2.0, zorder=3,
          clip_on=False)
  if y[0] > 0:
    ax.plot(x[:1], y[:1], "o", color=colour, markersize=5, zorder=4, clip_on=False)


def FractionAxis(ax):
  ax.set_ylim(0, 1)
  ax.yaxis.set_major_locator(ticker.FixedLocator([0, 0.25, 0.5, 0.75, 1]))
  ax.yaxis.set_major_formatter(ticker.FuncFormatter(lambda y, _: "%.0f" % (100 * y)))


def Distributions(table, chosen, column):
  """{method: (values, fractions)} of the chosen rows, finite ones."""
  solver = np.array(table["solver"])
  result = {}
  for method in Unique(solver[chosen]):
    mine = chosen & (solver == method) & np.isfinite(table[column])
    order = np.argsort(table[column][mine], kind="stable")
    result[method] = table[column][mine][order], table["fraction"][mine][order]
  return result


def ProfileFigure(arguments):
  path = arguments.table
  table = ReadTable(path, ("problems", "measure", "solver", "count", "ratio",
                           "fraction"), words=("problems", "measure", "solver"))
  if not table["solver"]:
    raise InputError("%s: no rows" % path)
  styles = MethodStyles(Unique(table["solver"]))
  problems, measures = np.array(table["problems"]), np.array(table["measure"])
  rows = Unique(table["problems"])
  figure, axes = ComparisonAxes(len(rows))
  for row, name in enumerate(rows):
    for column, (measure, label) in enumerate((("evaluations", "evaluations"),
                                               ("cpu_seconds", "CPU time"))):
      ax = axes[row, column]
      chosen = (problems == name) & (measures == measure)
      if not chosen.any():
        raise InputError("%s: no rows of %s, %s" % (path, name, measure))
      curves = Distributions(table, chosen, "ratio")
      most = max([values.max(initial=1.0) for values, _ in curves.values()])
      most = max(1.12 * most, 2.2)
      ax.set_xscale("log")
      ax.set_xlim(1, most)
      RatioTicks(ax.xaxis, most)
      ax.tick_params(axis="x", pad=6)
      for method, (values, fractions) in curves.items():
        Steps(ax, values, fractions, 1.0, most, styles[method])
      ax.set_xlabel(r"$\tau$: %s, relative to the cheapest method" % label)
    FractionAxis(axes[row, 0])
    axes[row, 0].set_ylabel("problems within $\\tau$ / %")
    count = table["count"][problems == name][0]
    axes[row, 0].set_title("%d problems (%s)" % (count, name) if "," in name else
                           "%d %s" % (count, name), loc="left", pad=7)
    axes[row, 1].tick_params(labelleft=False)
  FinishPanels(axes)
  MethodLegend(figure, styles)
  Help(figure, *PROFILE_HELP)
  return figure


QUALITY_LABELS = {
    "energy": r"$(E - E_{\mathrm{best}})\,/\,E$",
    "path": r"$|E - E_{\mathrm{ref}}|\,/\,E$",
    "excess": r"$(\phi_{\mathrm{cr}} - \phi_J)\,/\,\epsilon$",
}
ROUNDING = 1e-12  # relative differences below are rounding


def QualityFigure(arguments):
  path = arguments.table
  table = ReadTable(path, ("problems", "measure", "solver", "count", "value", "fraction",
                           "agreement", "reference", "agree", "judged", "low", "high"),
                    words=("problems", "measure", "solver", "agreement", "reference"))
  if not table["solver"]:
    raise InputError("%s: no rows" % path)
  measure = table["measure"][0]
  if measure not in QUALITY_LABELS:
    raise InputError("%s:2: measure %r is none of %s" %
                     (path, measure, ", ".join(QUALITY_LABELS)))
  names = Unique(table["solver"])
  styles = MethodStyles(names)
  labels = [Shortened(name) for name in names]
  height = 1.2 + max(3.0, 0.42 * len(names) + 0.6)
  # Room for the names and the counts beside them.
  longest = max(len(label) for label in labels)
  figure, axes = plt.subplots(
      1, 2, figsize=(11.0, height),
      gridspec_kw=dict(left=0.075, right=0.925, top=1 - 0.8 / height,
                       bottom=0.68 / height, wspace=0.12 + 0.024 * longest,
                       width_ratios=(1.5, 1)))
  ax = axes[0]
  curves = Distributions(table, np.ones(len(table["solver"]), bool), "value")
  values = np.concatenate([values for values, _ in curves.values()])
  ax.set_xscale("log")
  if measure == "excess":
    low, high = Span(np.append(values[values > 0], 1.0))
  else:
    low, high = math.log10(ROUNDING), 0.15
  ax.set_xlim(10**low, 10**high)
  Decades(ax.xaxis, low, high)
  if measure == "excess":
    ax.axvline(1.0, color=GREY, linewidth=1.2, linestyle=(0, (5, 3)), zorder=1)
  for method, (values, fractions) in curves.items():
    Steps(ax, values, fractions, 10**low, 10**high, styles[method])
  FractionAxis(ax)
  ax.set_xlabel(QUALITY_LABELS[measure])
  what = table["problems"][0]
  ax.set_ylabel("%s within / %%" % ("runs" if measure == "excess" else
                                    "strains" if measure == "path" else "problems"))
  ax.set_title("%d %s" % (table["count"][0], "problems (%s)" % what if "," in what
                          else "strains" if measure == "path" else what), loc="left",
               pad=7)

  ax = axes[1]
  names = Unique(table["solver"])
  reference = table["reference"][0]
  for k, name in enumerate(names):
    row = table["solver"].index(name)
    colour, _, marker = styles[name]
    agree, judged = table["agree"][row], table["judged"][row]
    if name == reference:
      ax.text(0.5, k, "the reference", ha="center", va="center", color=GREY,
              fontsize=11)
      continue
    if not judged:
      continue
    ax.plot([table["low"][row], table["high"][row]], [k, k], color=colour,
            linewidth=5, alpha=0.3, solid_capstyle="butt", zorder=2)
    ax.plot([agree / judged], [k], color=colour, marker=marker, markersize=9,
            clip_on=False, zorder=4)
    ax.text(1.03, k, "%d of %d" % (agree, judged), va="center", ha="left", fontsize=11,
            transform=ax.get_yaxis_transform(), color=INK)
  ax.set_ylim(len(names) - 0.4, -0.6)
  ax.set_xlim(-0.02, 1.02)
  ax.yaxis.set_major_locator(ticker.FixedLocator(range(len(names))))
  ax.yaxis.set_major_formatter(ticker.FixedFormatter(labels))
  ax.tick_params(axis="y", length=0, labelsize=11)
  ax.xaxis.set_major_locator(ticker.FixedLocator([0, 0.25, 0.5, 0.75, 1]))
  ax.xaxis.set_major_formatter(ticker.FuncFormatter(lambda x, _: "%.0f" % (100 * x)))
  ax.set_xlabel({"energy": "in the reference's minimum / %",
                 "path": "with the reference all the way / %",
                 "excess": r"$\phi_{\mathrm{cr}}$ within $\epsilon$ of the reference / %"}
                [measure])
  ax.set_title("agreement", loc="left", pad=7)
  FinishPanels(axes)
  ax.tick_params(axis="y", which="both", left=False, right=False)
  ax.grid(False, axis="y")
  MethodLegend(figure, styles)
  Help(figure, *QUALITY_HELP[measure])
  return figure


def Shortened(name, most=24):
  """A label that must stand beside an axis."""
  name = name.replace("$", r"\$")
  return name if len(name) <= most else name[:most - 1] + "\u2026"


def ProtocolFigure(arguments):
  return (JammingFigure if arguments.kind == "jamming" else ShearFigure)(arguments)


TOLERANCE_MARKERS = "osD^v"


def JammingFigure(arguments):
  path = arguments.data + "/protocol_runs.csv"
  table = ReadTable(path, ("tolerance", "seed", "repetition", "solver", "finished",
                           "phi_cr", "phi_unjammed", "phi_j", "branch", "evaluations",
                           "cpu_seconds"), words=("solver", "branch"))
  if not table["solver"]:
    raise InputError("%s: no rows" % path)
  if not arguments.epsilon or arguments.epsilon <= 0:
    raise InputError("--epsilon must be positive")
  epsilon = arguments.epsilon
  names = Unique(table["solver"])
  styles = MethodStyles(names)
  tolerances = sorted(set(table["tolerance"]), reverse=True)
  solver, branch = np.array(table["solver"]), np.array(table["branch"])
  excess = table["phi_cr"] - table["phi_j"]
  finished = table["finished"] > 0
  known = finished & np.isfinite(excess) & (excess > 0)
  crooked = known & (table["phi_j"] < table["phi_unjammed"] - epsilon)
  first = table["repetition"] == 1
  band = 0.8
  height = 1.5 + 0.62 * len(names) * max(1.0, 0.45 * len(tolerances))
  longest = max(len(Shortened(name)) for name in names)
  figure, axes = plt.subplots(
      1, 3, sharey=True, figsize=(11.0, height),
      gridspec_kw=dict(left=0.03 + 0.0092 * longest, right=0.98,
                       top=1 - 0.72 / height, bottom=0.68 / height, wspace=0.08,
                       width_ratios=(1.5, 1, 1)))
  panels = ((excess, known & first, r"$\phi_{\mathrm{cr}} - \phi_J$ of its branch"),
            (table["evaluations"], finished & first, "evaluations"),
            (table["cpu_seconds"], finished, "CPU time / s"))
  for column, (values, chosen, label) in enumerate(panels):
    ax = axes[column]
    shown = values[chosen & (values > 0)]
    low, high = Span(np.append(shown, epsilon) if column == 0 else shown)
    ax.set_xscale("log")
    ax.set_xlim(10**low, 10**high)
    Decades(ax.xaxis, low, high)
    for k, name in enumerate(names):
      colour = styles[name][0]
      if k % 2:
        ax.axhspan(k - 0.5, k + 0.5, facecolor="#F6F7F8", linewidth=0, zorder=0)
      for t, tolerance in enumerate(tolerances):
        y = k + band * ((t + 0.5) / len(tolerances) - 0.5)
        mine = chosen & (solver == name) & (table["tolerance"] == tolerance)
        marker = TOLERANCE_MARKERS[t % len(TOLERANCE_MARKERS)]
        if not mine.any():
          continue
        x = values[mine]
        ax.plot([x.min(), x.max()], [y, y], color=colour, linewidth=1.0, alpha=0.35,
                zorder=2)
        for value, open_, lost in zip(x, crooked[mine], branch[mine] == "lost"):
          hollow = column == 0 and open_
          bound = column == 0 and lost
          ax.plot([value], [y], linestyle="", marker=">" if bound else marker,
                  markersize=7 if bound else 6, color=colour, markeredgewidth=1.4,
                  markerfacecolor="white" if hollow else colour, zorder=4, clip_on=False)
    ax.set_xlabel(label)
    if column == 0:
      ax.axvline(epsilon, color=INK, linewidth=1.1, linestyle=(0, (5, 3)), zorder=3)
      ax.annotate(r"$\epsilon$", (epsilon, 1.0), xycoords=("data", "axes fraction"),
                  xytext=(0, 4), textcoords="offset points", ha="center", va="bottom")
  axes[0].set_ylim(len(names) - 0.5, -0.5)
  axes[0].yaxis.set_major_locator(ticker.FixedLocator(range(len(names))))
  axes[0].yaxis.set_major_formatter(ticker.FixedFormatter(
      [Shortened(name) for name in names]))
  for ax in axes:
    ax.grid(True, axis="x", which="major", color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True)
    ax.tick_params(axis="y", length=0)
  handles = [Line2D([], [], linestyle="", color=GREY, markersize=7,
                    marker=TOLERANCE_MARKERS[t % len(TOLERANCE_MARKERS)],
                    label="tolerance $10^{%d}$" % round(math.log10(tolerance))
                    if abs(math.log10(tolerance) - round(math.log10(tolerance))) < 1e-9
                    else "tolerance %g" % tolerance)
             for t, tolerance in enumerate(tolerances)]
  if (crooked & first).any():
    handles.append(Line2D([], [], linestyle="", color=GREY, markersize=7, marker="o",
                          markerfacecolor="white", markeredgewidth=1.4,
                          label="non-monotone bisection"))
  if ((branch == "lost") & known & first).any():
    handles.append(Line2D([], [], linestyle="", color=GREY, markersize=7, marker=">",
                          label="at least: the branch ends"))
  figure.legend(handles=handles, loc="upper center", ncol=len(handles), fontsize=12,
                bbox_to_anchor=(0.535, 1.0), handletextpad=0.2, columnspacing=1.6)
  Help(figure, *JAMMING_HELP)
  return figure


def ShearFigure(arguments):
  path = arguments.data + "/protocol_steps.csv"
  table = ReadTable(path, ("tolerance", "seed", "repetition", "solver", "strain",
                           "energy", "deviatoric_stress"), words=("solver",))
  if not table["solver"]:
    raise InputError("%s: no rows" % path)
  names = Unique(table["solver"])
  # The order of the plan, whatever ran first.
  runs = ReadTable(arguments.data + "/protocol_tables.csv", ("solver",),
                   words=("solver",)) if os.path.exists(
                       arguments.data + "/protocol_tables.csv") else {"solver": []}
  names = [name for name in Unique(runs["solver"]) if name in names] or names
  reference = arguments.reference or names[0]
  if reference not in names:
    raise InputError("%s: no rows of the method %r" % (path, reference))
  styles = MethodStyles(names)
  solver = np.array(table["solver"])
  tolerance = table["tolerance"].min()
  seeds = sorted(set(table["seed"]))[:3]
  height = 6.3
  figure, axes = plt.subplots(
      2, len(seeds), sharex=True, sharey="row", squeeze=False,
      figsize=(max(6.6, 0.9 + 3.9 * len(seeds)), height),
      gridspec_kw=dict(left=0.16 if len(seeds) == 1 else 0.085, right=0.98,
                       top=1 - 0.9 / height, bottom=0.68 / height, wspace=0.08,
                       hspace=0.1, height_ratios=(1.5, 1)))
  most = table["deviatoric_stress"].max()
  exponent = math.floor(math.log10(most)) if most > 0 else 0
  unit = 10.0**exponent if abs(exponent) > 2 else 1.0
  worst = ROUNDING
  for column, seed in enumerate(seeds):
    curves = {}
    for name in names:
      chosen = ((solver == name) & (table["seed"] == seed) &
                (table["tolerance"] == tolerance))
      order = np.argsort(table["strain"][chosen], kind="stable")
      curves[name] = [table[key][chosen][order]
                      for key in ("strain", "deviatoric_stress", "energy")]
    base = curves[reference]
    for name in names:
      colour, dashes, _ = styles[name]
      strain, stress, energy = curves[name]
      ahead = name == reference
      axes[0, column].plot(100 * strain, stress / unit, color=colour,
                           linestyle="-" if ahead else dashes,
                           linewidth=3.2 if ahead else 1.5,
                           alpha=0.45 if ahead else 1.0, zorder=2 if ahead else 3)
      if ahead:
        continue
      common = min(len(energy), len(base[2]))
      size = np.maximum(np.abs(energy[:common]), np.abs(base[2][:common]))
      apart = np.abs(energy[:common] - base[2][:common]) / np.where(size > 0, size, 1)
      worst = max(worst, apart.max(initial=0.0))
      axes[1, column].plot(100 * strain[:common], np.maximum(apart, ROUNDING),
                           color=colour, linestyle=dashes, linewidth=1.5, zorder=3)
    axes[0, column].set_title("seed %d" % seed, loc="left", pad=7)
    axes[1, column].set_xlabel(r"pure shear strain  $\gamma$ / %")
    axes[1, column].xaxis.set_major_locator(ticker.MaxNLocator(5, steps=[1, 2, 5, 10]))
    axes[1, column].margins(x=0.02)
  axes[0, 0].set_ylim(0, 1.08 * most / unit if most > 0 else 1)
  axes[0, 0].yaxis.set_major_locator(ticker.MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
  axes[0, 0].set_ylabel(r"deviatoric stress  $\sigma_{\mathrm{dev}}$" +
                        (r" / $10^{%d}$" % exponent if unit != 1 else ""))
  low, high = math.log10(ROUNDING), max(math.log10(worst) + 0.6, -9.0)
  axes[1, 0].set_yscale("log")
  axes[1, 0].set_ylim(10**low, 10**high)
  Decades(axes[1, 0].yaxis, low, high)
  axes[1, 0].set_ylabel(QUALITY_LABELS["path"])
  if len(seeds) > 1 or axes[0, 0].get_title():
    axes[0, -1].set_title("pale and wide: the reference, %s" % Shortened(reference),
                          loc="right", pad=7, fontsize=10.5, color=GREY)
  FinishPanels(axes)
  figure.align_ylabels(axes[:, 0])
  MethodLegend(figure, styles)
  Help(figure, *SHEAR_HELP)
  return figure


# ---------------------------------------------------------------- ensembles


# phi_J for N -> infinity and a rapid quench, bidisperse 1:1.4: O'Hern, Silbert, Liu,
# Nagel, Phys. Rev. E 68 (2003) 011306.
LITERATURE_PHI = {2: 0.8418, 3: 0.648}


def SizeColours(sizes):
  """The largest number of grains in blue, smaller ones in other colours."""
  order = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, "#56B4E9", INK, GREY)
  sizes = sorted(set(int(size) for size in sizes))
  return {size: order[k % len(order)] for k, size in enumerate(reversed(sizes))}


def ReadingHelp(figure, text, left=0.85):
  """Small print under the figure, broken to its width."""
  width, height = figure.get_size_inches()
  lines = textwrap.wrap(text, int(13.2 * (width - left - 0.1)))
  figure.text(left / width, 0.14 / height, "\n".join(lines), fontsize=10, color=GREY,
              va="bottom", linespacing=1.45)


def WithError(value, error):
  """0.842(3): the error in units of the last digit; two digits of it below 3.55, the
  rule of the Particle Data Group."""
  if not error > 0 or not math.isfinite(error):
    return "%.5g" % value
  digits = -math.floor(math.log10(error))
  if error * 10**digits < 3.55:
    digits += 1
  digits = max(0, digits)
  return "%.*f(%d)" % (digits, value, round(error * 10**digits))


def EnsembleFigure(arguments):
  path = arguments.table
  table = ReadTable(path, ("particles", "seed", "phi_j", "error"))
  if not len(table["phi_j"]):
    raise InputError("%s: no rows" % path)
  sizes = sorted(set(table["particles"].astype(int)))
  colours = SizeColours(sizes)
  literature = LITERATURE_PHI[arguments.dimension]
  low, high = table["phi_j"].min(), table["phi_j"].max()
  if low - 0.6 * (high - low) < literature < high + 0.6 * (high - low):
    low, high = min(low, literature), max(high, literature)
  air = 0.06 * (high - low) or 1e-3
  low, high = low - air, high + air
  row = 1.35 if len(sizes) > 1 else 2.6
  width, height = 8.2, 1.75 + row * len(sizes)
  figure, axes = plt.subplots(
      len(sizes), 1, sharex=True, squeeze=False, figsize=(width, height),
      gridspec_kw=dict(left=0.85 / width, right=1 - 1.75 / width,
                       top=1 - 0.3 / height, bottom=1.3 / height, hspace=0.16))
  # One width of the bins for all, from the rule of Freedman and Diaconis for the
  # widest row.
  spread = []
  for size in sizes:
    values = table["phi_j"][table["particles"] == size]
    quartiles = np.percentile(values, [25, 75])
    spread.append(2 * (quartiles[1] - quartiles[0]) / len(values)**(1 / 3))
  # A narrow row wants narrow bins, a wide one wide ones: the geometric mean.
  spread = [value for value in spread if value > 0] or [(high - low) / 20]
  width_of_bin = np.clip(np.exp(np.mean(np.log(spread))), (high - low) / 80,
                         (high - low) / 18)
  edges = np.arange(math.floor(low / width_of_bin),
                    math.ceil(high / width_of_bin) + 1) * width_of_bin
  low, high = edges[0], edges[-1]
  for ax, size in zip(axes[:, 0], sizes):
    values = table["phi_j"][table["particles"] == size]
    colour = colours[size]
    counts, _, _ = ax.hist(values, bins=edges, color=Mix(colour, "#FFFFFF", 0.6),
                           edgecolor=colour, linewidth=1.0, zorder=2)
    top = 1.32 * counts.max()
    ax.plot(values, np.full(len(values), 0.045 * top), "|", color=INK, markersize=7,
            markeredgewidth=0.9, zorder=4)
    mean = values.mean()
    text = r"$N = %d$" % size
    lines = ["%d packing%s" % (len(values), "" if len(values) == 1 else "s")]
    if len(values) > 1:
      deviation = values.std(ddof=1)
      error = deviation / math.sqrt(len(values))
      ax.errorbar([mean], [0.9 * top], xerr=[deviation], color=colour, linewidth=1.2,
                  capsize=3, zorder=5)
      ax.errorbar([mean], [0.9 * top], xerr=[error], color=colour, linewidth=4.0, zorder=5)
      lines += [r"$\langle\phi_J\rangle$ = %s" % WithError(mean, error),
                r"$\sigma$ = %#.2g" % deviation]
    ax.plot([mean], [0.9 * top], "o", color="white", markeredgecolor=colour,
            markeredgewidth=1.5, markersize=6, zorder=6)
    ax.axvline(literature, color=GREY, linewidth=1.1, linestyle=(0, (5, 3)), zorder=1)
    ax.set_ylim(0, top)
    ax.set_xlim(low, high)
    ax.yaxis.set_major_locator(ticker.MaxNLocator(3, integer=True, prune="lower"))
    ax.grid(True, axis="x", color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)
    ax.text(1.02, 0.93, text, transform=ax.transAxes, va="top", fontsize=12.5,
            color=colour, fontweight="bold")
    ax.text(1.02, 0.7, "\n".join(lines), transform=ax.transAxes, va="top", fontsize=10,
            color=INK, linespacing=1.35)
  figure.text(0.28 / width, (1.3 + 0.5 * (height - 1.6)) / height, "packings",
              rotation=90, ha="center", va="center", fontsize=14)
  axes[-1, 0].set_xlabel(r"packing fraction at jamming  $\phi_J$")
  ReadingHelp(figure, "Each tick is the jamming point of one packing; circle, thick and thin "
              "bar: their mean, its standard error, and their standard deviation. "
              "Dashed: %g, the literature\u2019s value for a rapid quench and N \u2192 "
              "\u221e; small packings jam below it." % literature)
  return figure


def FiniteSizeFigure(arguments):
  path = arguments.table
  table = ReadTable(path, ("particles", "complete", "phi_j", "standard_deviation",
                           "standard_error", "least", "most"))
  if not len(table["phi_j"]):
    raise InputError("%s: no rows" % path)
  fit = None
  if arguments.fit:
    try:
      fit = [float(word) for word in arguments.fit.split(",")]
      if len(fit) != 5 or not np.isfinite(fit).all():
        raise ValueError
    except ValueError:
      raise InputError("--fit=%s: five numbers expected" % arguments.fit)
  width, height = 7.6, 6.1
  figure = plt.figure(figsize=(width, height))
  ax = figure.add_axes([0.95 / width, 1.4 / height, 1 - 1.15 / width, 1 - 1.6 / height])
  n, mean = table["particles"], table["phi_j"]
  first, last = n.min() / 1.45, n.max() * 1.9
  ax.set_xscale("log")
  ax.set_xlim(first, last)
  literature = LITERATURE_PHI[arguments.dimension]
  ax.axhline(literature, color=GREY, linewidth=1.3, linestyle=(0, (5, 3)), zorder=1)
  ax.annotate("%g" % literature, (0.012, literature), xycoords=("axes fraction", "data"),
              xytext=(0, -3), textcoords="offset points", va="top", color=GREY, fontsize=11)
  ax.vlines(n, table["least"], table["most"], color=Mix(BLUE, "#FFFFFF", 0.55),
            linewidth=1.2, zorder=2)
  ax.vlines(n, mean - table["standard_deviation"], mean + table["standard_deviation"],
            color=Mix(BLUE, "#FFFFFF", 0.55), linewidth=5.0, zorder=2)
  ax.errorbar(n, mean, yerr=table["standard_error"], color=BLUE, linestyle="", marker="o",
              markersize=7, capsize=4, linewidth=1.8, zorder=5)
  if fit:
    phi, error, c, c_error, exponent = fit
    x = np.geomspace(first, last, 200)
    ax.plot(x, phi - c * x**-exponent, color=VERMILION, linewidth=1.7, zorder=4)
    ax.axhspan(phi - error, phi + error, color=VERMILION, alpha=0.13, linewidth=0, zorder=0)
    ax.text(0.97, 0.07, r"$\phi_J(N) = %s - %s\,N^{-%.3g}$" %
            (WithError(phi, error), WithError(c, c_error), exponent),
            transform=ax.transAxes, ha="right", color=VERMILION, fontsize=13.5)
  low, high = table["least"].min(), table["most"].max()
  low, high = min(low, literature), max(high, literature)
  ax.set_ylim(low - 0.05 * (high - low), high + 0.08 * (high - low))
  ax.set_xticks(n)
  ax.xaxis.set_major_formatter(ticker.FuncFormatter(lambda value, _: "%d" % round(value)))
  ax.xaxis.set_minor_locator(ticker.NullLocator())
  ax.set_xlabel("grains  $N$")
  ax.set_ylabel(r"packing fraction at jamming  $\phi_J$")
  ax.grid(True, color=PALE, linewidth=0.7)
  ax.set_axisbelow(True)
  ax.tick_params(which="both", top=True, right=True)
  counts = sorted(set(table["complete"].astype(int)))
  ReadingHelp(figure, "Points: means over %s packings with their standard errors; wide bars: "
              "standard deviation, thin ones: least to largest. %s" %
              ("%d" % counts[0] if len(counts) == 1 else "%d to %d" % (counts[0], counts[-1]),
               "Red: the fit, whose exponent is the literature\u2019s, and (band) where it "
               "ends for N \u2192 \u221e; dashed: where the literature says a rapid quench "
               "does." if fit else
               "Dashed: the literature\u2019s value for a rapid quench and N \u2192 \u221e."),
              left=0.95)
  return figure


def GrainCostFigure(arguments):
  path = arguments.table
  table = ReadTable(path, ("particles", "method", "threads", "evaluations", "seconds",
                           "energy_seconds", "peak_bytes"), words=("method",))
  methods = Unique(table["method"])
  if not methods:
    raise InputError("%s: no rows" % path)
  width, height = 12.6, 5.6
  figure, axes = plt.subplots(
      1, 2, figsize=(width, height),
      gridspec_kw=dict(left=0.95 / width, right=1 - 0.3 / width, top=1 - 0.45 / height,
                       bottom=1.4 / height, wspace=0.22))
  method = np.array(table["method"])
  colours = dict(zip(methods, (BLUE, VERMILION, GREEN, ORANGE, PURPLE)))
  for name in methods:
    colour = colours[name]
    for threads in Unique(table["threads"]):
      k = np.nonzero((method == name) & (table["threads"] == threads))[0]
      n = table["particles"][k]
      work = 1e9 / (table["evaluations"][k] * n)
      if threads > 1:
        axes[0].plot(n, table["seconds"][k] * work, color=colour, marker="s",
                     markersize=5, linewidth=1.2, linestyle=(0, (1, 1.5)),
                     label="by %d threads" % threads)
        continue
      axes[0].plot(n, table["seconds"][k] * work, color=colour, marker="o", linewidth=1.8,
                   label="%s, an iteration" % name)
      axes[0].plot(n, table["energy_seconds"][k] * work, color=colour, marker="o",
                   markersize=4, linewidth=1.2, linestyle=(0, (4, 2)),
                   label="of which the energy")
    k = np.nonzero((method == name) & (table["threads"] == table["threads"].min()))[0]
    n = table["particles"][k]
    axes[1].plot(n, table["peak_bytes"][k] / n, color=colour, marker="o", linewidth=1.8,
                 label=name)
  axes[0].set_title("time", loc="left", pad=7)
  axes[0].set_ylabel("ns a grain")
  axes[0].set_ylim(0, None)
  axes[0].legend(loc="upper left", frameon=False)
  axes[1].set_title("memory of the process", loc="left", pad=7)
  axes[1].set_ylabel("bytes a grain, at most")
  axes[1].set_yscale("log")
  axes[1].axhline(1000, color=GREY, linewidth=1.3, linestyle=(0, (5, 3)))
  axes[1].set_yticks((1e3, 1e4), labels=("$10^3$", "$10^4$"))
  axes[1].legend(loc="upper right", frameon=False)
  for ax in axes:
    ax.set_xscale("log")
    ax.set_xlabel("grains  $N$")
    ax.grid(True, color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)
  ReadingHelp(figure, "First-order methods on discs that still rearrange, with the lists of "
              "neighbours that this needs. Small packings live in caches, large ones wait "
              "for memory. Right: all that the process takes, libraries included; dashed: "
              "a kilobyte a grain.", left=0.95)
  return figure


LAWS = (("pressure", "pressure  $p$", "Fig. 4"), ("shear", "shear modulus  $G$ (13)", "Fig. 5"),
        ("excess", r"excess contacts  $z - z_{\rm iso}$", "Fig. 6"),
        ("bulk", r"bulk modulus  $B$ (12)", ""))
ALPHA_COLOURS = (BLUE, VERMILION, GREEN, PURPLE)


def Claimed(name, alpha):
  """The exponent that the paper finds; for B the theory's."""
  return {"pressure": alpha - 1, "shear": alpha - 1.5, "excess": 0.5,
          "bulk": alpha - 2}[name]


def Shade(colour):
  return Mix(colour, "#FFFFFF", 0.45)


def LawsFigure(arguments):
  path = arguments.table
  table = ReadTable(path, ("particles", "alpha", "asked", "distance") +
                    tuple(law[0] for law in LAWS))
  if not len(table["alpha"]):
    raise InputError("%s: no rows" % path)
  fits = {}
  if arguments.exponents:
    rows = ReadTable(arguments.exponents,
                     ("quantity", "alpha", "particles", "exponent", "low", "high",
                      "prefactor", "from", "to", "distances"), words=("quantity",))
    for k, name in enumerate(rows["quantity"]):
      fits[name, rows["alpha"][k], rows["particles"][k]] = {
          key: rows[key][k] for key in rows if key != "quantity"}
  size = table["particles"].max()
  of_size = table["particles"] == size
  alphas = sorted(set(table["alpha"][of_size]))
  colours = {alpha: ALPHA_COLOURS[k % 4] for k, alpha in enumerate(alphas)}
  width, height = 12.2, 9.6
  figure, axes = plt.subplots(
      2, 2, figsize=(width, height), sharex=True,
      gridspec_kw=dict(left=0.95 / width, right=1 - 0.25 / width, top=1 - 0.8 / height,
                       bottom=1.45 / height, wspace=0.2, hspace=0.1))
  packings, negative = 0, False
  for ax, (name, label, paper) in zip(axes.flat, LAWS):
    ax.set_xscale("log")
    ax.set_yscale("log")
    lines = []
    for alpha in alphas:
      chosen = of_size & (table["alpha"] == alpha)
      x, y, asked = (table[key][chosen] for key in ("distance", name, "asked"))
      good = y > 0
      ax.plot(x[good], y[good], "o", color=Shade(colours[alpha]), markersize=3.2,
              markeredgewidth=0, zorder=2)
      if name == "shear" and (~good).any():
        negative = True
        ax.plot(x[~good], -y[~good], "v", color="white", markersize=5,
                markeredgecolor=Shade(colours[alpha]), zorder=2)
      levels = sorted(set(asked))
      middle_x = np.array([np.median(x[asked == level]) for level in levels])
      middle_y = np.array([np.median(y[asked == level]) for level in levels])
      packings = max(packings, int((asked == levels[0]).sum()))
      up = middle_y > 0
      ax.plot(middle_x[up], middle_y[up], "o", color=colours[alpha], markersize=7.5,
              markeredgecolor="white", markeredgewidth=0.8, zorder=5)
      fit = fits.get((name, alpha, size))
      text = r"$\alpha = %g$" % alpha
      if fit and fit["distances"] >= 2:
        ends = np.array([fit["from"], fit["to"]])
        ax.plot(ends, fit["prefactor"] * ends**fit["exponent"], color=colours[alpha],
                linewidth=1.8, zorder=4)
        text += ":  %.3f" % fit["exponent"]
        if fit["low"] < fit["high"]:
          text += "  [%.3f, %.3f]" % (fit["low"], fit["high"])
      if up.any():
        claim = Claimed(name, alpha)
        # Through the upper half, where every packing is on the law.
        k = np.nonzero(up)[0][len(np.nonzero(up)[0]) // 2:]
        level = np.exp(np.mean(np.log(middle_y[k]) - claim * np.log(middle_x[k])))
        ends = np.array([middle_x.min() / 1.5, middle_x.max() * 1.5])
        ax.plot(ends, level * ends**claim, color=GREY, linewidth=1.3,
                linestyle=(0, (5, 3)), zorder=3)
        text += "   (%s %g)" % ("paper" if paper else "theory", claim)
      lines.append((text, colours[alpha]))
    values = table[name][of_size]
    low, high = Span(values[values > 0])
    if name == "bulk":
      low, high = low - 0.6, high + 0.5
    ax.set_ylim(10**low, 10**(high + 0.16 * (high - low)))
    Decades(ax.yaxis, low, high)
    ax.set_ylabel(label)
    for k, (text, colour) in enumerate(lines):
      ax.text(0.03, 0.965 - 0.062 * k, text, transform=ax.transAxes, va="top",
              color=colour, fontsize=12)
    if paper:
      ax.text(0.975, 0.035, paper, transform=ax.transAxes, ha="right", color=GREY)
    ax.grid(True, color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)
  low, high = Span(table["distance"][of_size])
  for ax in axes[1]:
    ax.set_xlim(10**low, 10**high)
    Decades(ax.xaxis, low, high)
    ax.set_xlabel(r"$\phi - \phi_J$")
  figure.text(0.95 / width, 1 - 0.5 / height, "$N = %d$, %d packing%s for each exponent "
              "of the contact energy" % (size, packings, "" if packings == 1 else "s"),
              fontsize=14)
  ReadingHelp(figure, "Small dots: packings; circles: their medians; lines: fits through "
              "the medians, exponent with its 95 % interval over packings; dashed: the exponent "
              "claimed, through the upper half of the medians."
              + (" Open triangles: negative shear moduli, as |G|; medians count them as negative."
                 if negative else ""), left=0.95)
  return figure


def CollapseFigure(arguments):
  path = arguments.table
  table = ReadTable(path, ("particles", "alpha", "asked", "reduced", "excess", "shear",
                           "stiffness", "rigid_grains"))
  if not len(table["alpha"]):
    raise InputError("%s: no rows" % path)
  sizes, alphas = sorted(set(table["particles"])), sorted(set(table["alpha"]))
  colours = SizeColours(sizes)
  markers = dict(zip(alphas, "os^D"))
  width, height = 12.2, 5.9
  figure, axes = plt.subplots(
      1, 2, figsize=(width, height),
      gridspec_kw=dict(left=0.95 / width, right=1 - 0.25 / width, top=1 - 0.3 / height,
                       bottom=1.65 / height, wspace=0.2))
  # Excess contacts: those beyond isostatic, 2 N_c / N' - 4 + 2 / N', times N'.
  panels = (("excess", lambda t: t["excess"] * t["rigid_grains"], r"$(z - z_{\rm iso})\,N'$"),
            ("shear", lambda t: t["shear"] / t["stiffness"] * t["particles"],
             r"$G\,N\,/\,\kappa$"))
  everything = []
  for ax, (name, scaled, label) in zip(axes, panels):
    ax.set_xscale("log")
    ax.set_yscale("log")
    values = scaled(table)
    drawn = []
    for size in sizes:
      for alpha in alphas:
        chosen = (table["particles"] == size) & (table["alpha"] == alpha)
        xs, ys, errors, lost = [], [], [], []
        for level in sorted(set(table["asked"][chosen])):
          k = chosen & (table["asked"] == level)
          x = np.median(table["reduced"][k]) * size**2
          y = np.median(values[k])
          if y > 0:
            xs.append(x)
            ys.append(y)
            errors.append(np.percentile(values[k], (25, 75)))
          else:
            lost.append((x, -y))
        everything += xs
        drawn += ys
        if xs:
          low, high = np.array(errors).T
          ys = np.array(ys)
          ax.errorbar(xs, ys, yerr=(np.minimum(ys - low, 0.9 * ys), high - ys), color=colours[size], linewidth=1.2,
                      linestyle="", marker=markers[alpha], markersize=7, capsize=2,
                      markeredgecolor="white", zorder=4)
        if lost:
          ax.plot(*zip(*lost), "v", color="white", markersize=7,
                  markeredgecolor=colours[size], zorder=3)
    if drawn:
      low, high = Span(np.array(drawn))
      ax.set_ylim(10**low, 10**high)
      Decades(ax.yaxis, low, high)
    ax.set_ylabel(label)
    ax.set_xlabel("$P\\,N^2$")
    ax.grid(True, color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)
  if everything:
    low, high = Span(np.array(everything))
    for ax in axes:
      ax.set_xlim(10**low, 10**high)
      Decades(ax.xaxis, low, high)
      bottom, top = ax.get_ylim()
      x = np.array([10**max(low, 1.0), 10**high])
      # Slope 1/2 through the largest size at the upper end.
      points = [(line.get_xdata(), line.get_ydata()) for line in ax.get_lines()
                if len(line.get_xdata()) > 1 and line.get_marker() != "v"]
      if points:
        ends = max(((xs[-1], ys[-1]) for xs, ys in points), key=lambda point: point[0])
        ax.plot(x, ends[1] * (x / ends[0])**0.5, color=GREY, linewidth=1.3,
                linestyle=(0, (5, 3)), zorder=1)
        ax.text(0.97, 0.06, "dashed: slope 1/2", transform=ax.transAxes, ha="right",
                color=GREY)
      ax.set_ylim(bottom, top)
  handles = [Line2D([], [], linestyle="", marker="o", markersize=8, color=colours[size],
                    label="$N = %d$" % size) for size in reversed(sizes)]
  handles += [Line2D([], [], linestyle="", marker=markers[alpha], markersize=8,
                     markerfacecolor="white", markeredgecolor=INK,
                     label=r"$\alpha = %g$" % alpha) for alpha in alphas]
  axes[0].legend(handles=handles, loc="upper left", fontsize=12, handletextpad=0.2)
  ReadingHelp(figure, "Medians and quartiles over packings, P = (p / (k r^(\u03b1\u2212d)))"
              "^(1/(\u03b1\u22121)), \u03ba the mean stiffness of contacts. That all sizes lie on one "
              "curve is finite-size scaling (Goodrich, Liu, Nagel 2012); where P N\u00b2 falls below "
              "10 a packing has hardly a contact more than it must. Open triangles: medians of "
              "G that are negative, as |G|.", left=0.95)
  return figure


def VibrationsFigure(arguments):
  path = arguments.table
  table = ReadTable(path, ("particles", "seed", "alpha", "asked", "complete", "frequency",
                           "participation"))
  chosen = (table["complete"] == 1) & (table["frequency"] > 0)
  if not chosen.any():
    raise InputError("%s: no complete spectrum" % path)
  size = table["particles"][chosen].max()
  alpha = table["alpha"][chosen].min()
  chosen &= (table["particles"] == size) & (table["alpha"] == alpha)
  levels = sorted(set(table["asked"][chosen]))
  order = (BLUE, GREEN, ORANGE, VERMILION, PURPLE, INK)
  width, height = 12.2, 5.9
  figure, axes = plt.subplots(
      1, 2, figsize=(width, height), sharex=True,
      gridspec_kw=dict(left=0.95 / width, right=1 - 0.25 / width, top=1 - 0.3 / height,
                       bottom=1.45 / height, wspace=0.2))
  frequencies = table["frequency"][chosen]
  low, high = math.log10(frequencies.min()), math.log10(frequencies.max())
  edges = np.logspace(low, high, 21)
  packings = 1
  for k, level in enumerate(levels):
    here = chosen & (table["asked"] == level)
    packings = max(packings, len(set(table["seed"][here])))
    omega, participation = table["frequency"][here], table["participation"][here]
    counts, _ = np.histogram(omega, edges)
    sums, _ = np.histogram(omega, edges, weights=participation)
    some = counts > 0
    middle = np.sqrt(edges[1:] * edges[:-1])
    density = counts / np.diff(edges) / len(omega)
    colour = order[k % len(order)]
    label = r"$\phi - \phi_J = %s$" % Power(level)
    axes[0].plot(middle[some], density[some], color=colour, marker="o", markersize=4,
                 label=label)
    axes[1].plot(omega, participation, ".", color=Shade(colour), markersize=1.5,
                 rasterized=True, zorder=1)
    axes[1].plot(middle[some], sums[some] / counts[some], color=colour, marker="o",
                 markersize=4, zorder=3)
  for ax in axes:
    ax.set_xscale("log")
    ax.set_xlim(10**(low - 0.1), 10**(high + 0.1))
    Decades(ax.xaxis, low - 0.1, high + 0.1)
    ax.set_xlabel(r"frequency  $\omega\,/\,\sqrt{\kappa/m}$")
    ax.grid(True, color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)
  axes[0].set_yscale("log")
  axes[0].set_ylabel(r"density of states  $D(\omega)$")
  axes[0].legend(loc="lower right", fontsize=12)
  axes[1].set_ylabel("participation ratio")
  axes[1].set_ylim(0, 1)
  unstable = int(((table["frequency"] < 0) & (table["particles"] == size)).sum())
  ReadingHelp(figure, "All modes of %d packing%s, N = %d, \u03b1 = %g, masses 1, \u03ba the mean stiffness "
              "of contacts. Nearer to jamming the plateau reaches to lower frequencies. Right: "
              "1 if all grains take part alike, 1/N' for a single one; lines: means.%s" %
              (packings, "" if packings == 1 else "s", size, alpha,
               " %d unstable modes are not shown." % unstable if unstable else ""),
              left=0.95)
  return figure


# Of EXTREMES.csv: fill, ink and what it means, in order of severity.
CELLS = (("passed", "#CFE6D8", GREEN, "passed: a certified minimum, or E = 0"),
         ("stationary", "#BCD6EA", BLUE, "converged, not certified a minimum"),
         ("degraded", "#F6E7C4", "#8A5A00", "ended with this residual, and says so"),
         ("refused", "#E4E9EE", GREY, "refused, with a reason"),
         ("lost", "#E9D3E2", "#8E3C6B", "not finite, hung or crashed"),
         ("wrong", VERMILION, "white", "claims what is not so"))


FLOW_CELLS = {"passed": "passed: reached its end, energies agree",
              "stationary": "not of flows",
              "degraded": "part of the energy made or lost by the integrator"}


def ExtremesFigure(arguments):
  path = arguments.table
  table = ReadTable(path, ("extreme", "group", "solver", "cell", "residual"),
                    words=("extreme", "group", "solver", "cell"))
  extremes, methods = Unique(table["extreme"]), Unique(table["solver"])
  if not extremes:
    raise InputError("%s: no rows" % path)
  styles = {name: (fill, ink) for name, fill, ink, _ in CELLS}
  group_of = dict(zip(table["extreme"], table["group"]))
  cell, gap = (0.86, 0.27), 0.34
  groups = Unique(group_of[extreme] for extreme in extremes)
  width = 2.6 + cell[0] * len(methods) + 0.2
  # The key, in as many lines as it takes.
  key, x, line = [], 0.2, 0
  flows = set(methods) <= {"implicit", "verlet", "minimize"}
  for name, fill, ink, words in CELLS:
    words = FLOW_CELLS.get(name, words) if flows else words
    label = "%d  %s" % (table["cell"].count(name), words)
    if x > 0.2 and x + 0.35 + 0.085 * len(label) > width:
      x, line = 0.2, line + 1
    key.append((x, line, fill, label))
    x += 0.55 + 0.085 * len(label)
  left, top, bottom = 2.6, 0.7, 0.75 + 0.3 * line
  height = top + cell[1] * len(extremes) + gap * len(groups) + bottom
  figure = plt.figure(figsize=(width, height))
  ax = figure.add_axes([0, 0, 1, 1])
  ax.set_xlim(0, width)
  ax.set_ylim(height, 0)
  ax.set_axis_off()
  for k, method in enumerate(methods):
    ax.text(left + (k + 0.5) * cell[0], top - 0.08, method.replace("_", "\n"), ha="center",
            va="bottom", fontsize=10.5)
  at, y, last = {}, top, None
  for extreme in extremes:
    if group_of[extreme] != last:
      last = group_of[extreme]
      ax.text(0.2, y + 0.27, last, fontsize=11.5, fontweight="bold", va="bottom")
      y += gap
    ax.text(left - 0.1, y + 0.5 * cell[1], extreme.replace("_", " "), ha="right",
            va="center", fontsize=10)
    at[extreme] = y
    y += cell[1]
  for extreme, method, state, residual in zip(table["extreme"], table["solver"],
                                              table["cell"], table["residual"]):
    if state not in styles:
      raise InputError("%s: cell %r is none of %s" % (path, state, ", ".join(styles)))
    fill, ink = styles[state]
    x = left + methods.index(method) * cell[0]
    ax.add_patch(Rectangle((x + 0.02, at[extreme] + 0.015), cell[0] - 0.04, cell[1] - 0.03,
                           facecolor=fill, linewidth=0))
    text = {"passed": "ok", "stationary": "stationary"}.get(state, state)
    if state == "degraded":
      text = "%.0e" % residual if residual > 0 else "0"
    ax.text(x + 0.5 * cell[0], at[extreme] + 0.5 * cell[1], text, ha="center", va="center",
            fontsize=9, color=ink)
  for x, line, fill, label in key:
    y = height - bottom + 0.4 + 0.3 * line
    ax.add_patch(Rectangle((x, y - 0.09), 0.22, 0.18, facecolor=fill, linewidth=0))
    ax.text(x + 0.3, y, label, va="center", fontsize=10, color=INK)
  return figure


TRADED = (("pressure", "error of the pressure"), ("shear_modulus", "error of $G$ (13)"),
          ("places", "error of places, in overlaps"))
FLOOR = 1e-15  # errors below are drawn there


def TradeoffFigure(arguments):
  path = arguments.table
  names = [name for name, _ in TRADED]
  table = ReadTable(path, ("scene", "seed", "solver", "precision", "tolerance", "reached",
                           "cpu_seconds", *names), words=("scene", "solver", "precision"))
  scenes = Unique(table["scene"])
  if not scenes:
    raise InputError("%s: no rows" % path)
  styles = MethodStyles(Unique(table["solver"]))
  scene, solver = np.array(table["scene"]), np.array(table["solver"])
  precision = np.array(table["precision"])
  rows = len(scenes)
  width, height = 13.2, 1.9 + 3.9 * rows
  figure, axes = plt.subplots(
      rows, 3, figsize=(width, height), squeeze=False, sharex="row",
      gridspec_kw=dict(left=0.95 / width, right=1 - 0.2 / width, top=1 - 0.8 / height,
                       bottom=1.3 / height, wspace=0.26, hspace=0.28))
  for row, name_of_scene in enumerate(scenes):
    here = scene == name_of_scene
    finite = here & np.isfinite(table["cpu_seconds"]) & (table["cpu_seconds"] > 0)
    if not finite.any():
      continue
    factor, unit = TimeUnit(table["cpu_seconds"][finite].max())
    x_low, x_high = Span(factor * table["cpu_seconds"][finite])
    for ax, (name, label) in zip(axes[row], TRADED):
      ax.set_xscale("log")
      ax.set_yscale("log")
      everything = []
      for method, (colour, _, marker) in styles.items():
        for kind in Unique(precision):
          mine = here & (solver == method) & (precision == kind)
          xs, ys = [], []
          for level in sorted(set(table["tolerance"][mine]), reverse=True):
            k = mine & (table["tolerance"] == level)
            error = table[name][k].max()
            # Where a packing did not get there, there is no error and no time.
            if math.isfinite(error) and np.isfinite(table["cpu_seconds"][k]).all():
              xs.append(factor * np.median(table["cpu_seconds"][k]))
              ys.append(max(error, FLOOR))
          if not xs:
            continue
          everything += zip(xs, ys)
          ax.plot(xs, ys, color=colour, linestyle={"double": "-", "mixed": (0, (4, 2)),
                                                   "float": (0, (1, 1.5))}[kind],
                  linewidth=1.2, marker=marker, markersize=4.5 if kind == "double" else 3,
                  zorder=3)
      # What no setting beats.
      front, best = [], np.inf
      for x, y in sorted(everything):
        if y < best:
          front += [(x, best), (x, y)]
          best = y
      front = front[1:] + [(10**x_high, best)]
      if everything:
        ax.plot(*zip(*front), color=GREY, linewidth=5, alpha=0.3, zorder=1,
                solid_joinstyle="miter")
      y_low, y_high = Span(np.array([y for _, y in everything])) if everything else (-1, 0)
      ax.set_xlim(10**x_low, 10**x_high)
      ax.set_ylim(10**y_low, 10**y_high)
      Decades(ax.xaxis, x_low, x_high)
      Decades(ax.yaxis, y_low, y_high)
      ax.set_ylabel(label)
      ax.set_xlabel(unit)
      ax.grid(True, color=PALE, linewidth=0.7)
      ax.set_axisbelow(True)
      ax.tick_params(which="both", top=True, right=True)
    axes[row, 0].set_title(name_of_scene, loc="left", pad=7)
  MethodLegend(figure, styles, markers=True)
  ReadingHelp(figure, "A marker a decade of the tolerance, 1e-1 to 1e-13; solid: double, dashed: "
              "mixed, dotted: single precision. Errors: the largest over packings, against "
              "the minimum that the run ends in, 1e-15 at least; times: medians. Grey: what no "
              "setting beats.", left=0.95)
  return figure


FLOW_TRADED = (("kinetic", "error of $T(t)$, relative"),
               ("relative_part", "error of the relative part"),
               ("places", "error of places, in radii"))
FLOW_TRADED_TITLES = {
    "smooth": "smooth: near field alone", "paper": "paper: impacts, (0.25, 0.125), 0.4 s",
    "strong": "strong: impacts, (0.5, 0.25), 1 s, means of starts",
    "many": "many: errors of forces alone"}


def TradeoffFlowFigure(arguments):
  """Errors of a flow against CPU time, a line a stepper and tolerance."""
  path = arguments.table
  table = ReadTable(path, ("scene", "family", "tolerance", "dt", "field_accuracy", "threads",
                           "cpu_seconds", *[name for name, _ in FLOW_TRADED],
                           *[name + "_is_bound" for name, _ in FLOW_TRADED]),
                    words=("scene", "family"), optional=())
  scene, family = np.array(table["scene"]), np.array(table["family"])
  steps = table["field_accuracy"] < 0
  scenes = [name for name in Unique(table["scene"]) if (steps & (scene == name)).any()]
  if not scenes:
    raise InputError("%s: no steppers" % path)
  names = Unique(family[steps])
  styles = {name: FLOW_TRADED_STYLES.get(name, (INK, "-", "x")) for name in names}
  rows = len(scenes)
  width, height = 13.2, 2.3 + 3.6 * rows
  figure, axes = plt.subplots(
      rows, 3, figsize=(width, height), squeeze=False, sharex="row",
      gridspec_kw=dict(left=0.95 / width, right=1 - 0.2 / width, top=1 - 0.8 / height,
                       bottom=1.55 / height, wspace=0.27, hspace=0.32))
  for row, name_of_scene in enumerate(scenes):
    here = steps & (scene == name_of_scene) & np.isfinite(table["cpu_seconds"])
    for ax, (name, label) in zip(axes[row], FLOW_TRADED):
      ax.set_xscale("log")
      ax.set_yscale("log")
      ax.set_ylabel(label)
      ax.set_xlabel("CPU time / ms")
      good = here & np.isfinite(table[name]) & (table[name] > 0)
      if not good.any():
        ax.text(0.5, 0.5, "starts part from each other:\nplaces mean nothing",
                transform=ax.transAxes, ha="center", va="center", color=GREY)
        ax.set_axis_off()
        continue
      everything = []
      for stepper, (colour, dashes, marker) in styles.items():
        for tolerance in Unique(table["tolerance"][good & (family == stepper)]):
          k = good & (family == stepper) & (table["tolerance"] == tolerance)
          xs, ys = 1e3 * table["cpu_seconds"][k], table[name][k]
          order = np.argsort(-table["dt"][k])
          xs, ys = xs[order], ys[order]
          bound = table[name + "_is_bound"][k][order] > 0
          everything += zip(xs, ys)
          ax.plot(xs, ys, color=colour, linestyle=dashes, linewidth=1.1, zorder=3)
          for hollow in (False, True):
            ax.plot(xs[bound == hollow], ys[bound == hollow], color=colour, linestyle="none",
                    marker=marker, markersize=4.5, zorder=3,
                    markerfacecolor="white" if hollow else colour)
      front, best = [], np.inf
      for x, y in sorted(everything):
        if y < best:
          front += [(x, best), (x, y)]
          best = y
      x_low, x_high = Span(np.array([x for x, _ in everything]))
      y_low, y_high = Span(np.array([y for _, y in everything]))
      ax.plot(*zip(*(front[1:] + [(10**x_high, best)])), color=GREY, linewidth=5, alpha=0.3,
              zorder=1, solid_joinstyle="miter")
      ax.set_xlim(10**x_low, 10**x_high)
      ax.set_ylim(10**y_low, 10**y_high)
      Decades(ax.xaxis, x_low, x_high)
      Decades(ax.yaxis, y_low, y_high)
      ax.grid(True, color=PALE, linewidth=0.7)
      ax.set_axisbelow(True)
      ax.tick_params(which="both", top=True, right=True)
    axes[row, 0].set_title(FLOW_TRADED_TITLES.get(name_of_scene, name_of_scene), loc="left",
                           pad=7)
  MethodLegend(figure, styles, markers=True)
  ReadingHelp(figure, "A line a stepper and tolerance, a marker a step, each half as long as the "
              "one before. Errors: the largest over starts against Verlet with a step some "
              "thousand times shorter, or, where starts part, those of means over starts with two "
              "standard errors; hollow: no more than what is not known of the exact flow, or than "
              "noise. Grey: what no way beats.", left=0.95)
  return figure


def PhiJFigure(arguments):
  path = arguments.table
  table = ReadTable(path, ("seed", "solver", "tolerance", "error_bar", "error",
                           "cpu_seconds"), words=("solver",))
  if not len(table["seed"]):
    raise InputError("%s: no rows" % path)
  solver = np.array(table["solver"])
  styles = MethodStyles(Unique(table["solver"]))
  width, height = 12.2, 6.0
  figure, axes = plt.subplots(
      1, 2, figsize=(width, height), sharey=True,
      gridspec_kw=dict(left=1.0 / width, right=1 - 0.25 / width, top=1 - 0.7 / height,
                       bottom=1.4 / height, wspace=0.08))
  factor, unit = TimeUnit(table["cpu_seconds"].max())
  error = np.maximum(table["error"], 1e-16)
  for ax, x in ((axes[0], factor * table["cpu_seconds"]), (axes[1], table["error_bar"])):
    ax.set_xscale("log")
    ax.set_yscale("log")
    for method, (colour, _, marker) in styles.items():
      for level in sorted(set(table["tolerance"])):
        for seed in sorted(set(table["seed"])):
          k = (solver == method) & (table["tolerance"] == level) & (table["seed"] == seed)
          k &= table["error"] > 0  # the last estimate is what it is judged by
          if k.any():
            ax.plot(x[k], error[k], color=colour, linewidth=0.9, marker=marker,
                    markersize=4, alpha=0.75)
    low, high = Span(x[x > 0])
    ax.set_xlim(10**low, 10**high)
    Decades(ax.xaxis, low, high)
    ax.grid(True, color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)
  low, high = Span(error[table["error"] > 0]) if (table["error"] > 0).any() else (-12, -3)
  axes[0].set_ylim(10**low, 10**high)
  Decades(axes[0].yaxis, low, high)
  limits = np.array(axes[1].get_xlim())
  axes[1].plot(limits, limits, color=GREY, linewidth=1.3, linestyle=(0, (5, 3)), zorder=1)
  axes[0].set_ylabel(r"$|\phi_J - $ the sharpest one of the run$|$")
  axes[0].set_xlabel(unit)
  axes[1].set_xlabel(r"error bar of $\phi_J$ at that moment")
  MethodLegend(figure, styles, markers=True)
  ReadingHelp(figure, "Decompressions from over-jammed states, a marker a state, lines: packings and "
              "tolerances (1e-4, 1e-8). Right: below the dashed line the error is less "
              "than the error bar that the run states.", left=1.0)
  return figure


def FidelityFigure(arguments):
  path = arguments.table
  table = ReadTable(path, ("model", "quantity", "mean", "difference", "difference_error",
                           "verdict", "cpu_seconds_a_step"),
                    words=("model", "quantity", "verdict"))
  models, quantities = Unique(table["model"]), Unique(table["quantity"])
  if not models:
    raise InputError("%s: no rows" % path)
  whole = next((k for k, name in enumerate(models) if "whole)" in name or "whole:" in name), 0)
  model, quantity = np.array(table["model"]), np.array(table["quantity"])
  verdict = np.array(table["verdict"])
  width, height = 13.2, 1.75 + 0.34 * len(models)
  figure, axes = plt.subplots(
      1, len(quantities) + 1, figsize=(width, height), sharey=True,
      gridspec_kw=dict(left=2.1 / width, right=1 - 0.2 / width, top=1 - 0.45 / height,
                       bottom=1.2 / height, wspace=0.1))
  places = -np.arange(len(models))
  cost = np.array([table["cpu_seconds_a_step"][model == name][0] for name in models])
  axes[0].barh(places, cost / cost[whole], height=0.6, color=SPECIES_FILLS[0])
  axes[0].set_title("cost of a step", loc="left", fontsize=12)
  axes[0].set_xlabel("whole model = 1")
  axes[0].set_yticks(places, models, fontsize=11)
  axes[0].set_ylim(-len(models) + 0.4, 0.6)
  colours = {"ok": GREEN, "no": VERMILION, "?": GREY}
  for ax, name in zip(axes[1:], quantities):
    size = abs(table["mean"][(model == models[whole]) & (quantity == name)][0]) or 1.0
    ax.axvspan(-100 * arguments.accuracy, 100 * arguments.accuracy, color="#E6F2EA",
               linewidth=0, zorder=0)
    ax.axvline(0, color=GREY, linewidth=0.8, zorder=1)
    for place, one in zip(places, models):
      k = np.nonzero((model == one) & (quantity == name))[0][0]
      if one == models[whole]:
        continue
      ax.errorbar(100 * table["difference"][k] / size, place,
                  xerr=200 * table["difference_error"][k] / size, color=colours[verdict[k]],
                  marker="o", markersize=5.5, capsize=3, linewidth=1.4, zorder=3)
    ax.set_title(name.replace("_", " "), loc="left", fontsize=12)
    ax.set_xlabel("change / %")
    band = 100 * arguments.accuracy
    ax.set_xscale("symlog", linthresh=2 * band)
    low, high = ax.get_xlim()
    low, high = min(low, -2 * band), max(high, 2 * band)
    ax.set_xlim(low, high)
    ax.xaxis.set_major_locator(ticker.FixedLocator(
        [tick for tick in (-1000, -100, -2 * band, 0, 2 * band, 100, 1000)
         if low <= tick <= high]))
    ax.xaxis.set_minor_locator(ticker.NullLocator())
    ax.xaxis.set_major_formatter(ticker.FuncFormatter(lambda value, _: "%g" % value))
    ax.tick_params(axis="x", labelsize=10)
  for ax in axes:
    ax.grid(True, axis="x", color=PALE, linewidth=0.6)
    ax.set_axisbelow(True)
  ReadingHelp(figure, "Changes from the whole model, start by start: means and two standard "
              "errors. Band: the accuracy asked for, %g %%; green: within it, vermilion: "
              "beyond it, grey: more starts would tell." % (100 * arguments.accuracy),
              left=0.3)
  return figure


# Of DISTRIBUTIONS.csv: what a panel shows.
QUANTITIES = (
    ("theta_localized", "weak forces of bucklers", r"$f\,/\,\langle f\rangle$",
     r"\theta_\ell", 1),
    ("theta_extended", "weak forces of all others", r"$f\,/\,\langle f\rangle$",
     r"\theta_e", 1),
    ("gamma", "small gaps", r"gap  $h\,/\,(r_i + r_j)$", r"\gamma", -1))


def DistributionsFigure(arguments):
  """Cumulative, so that nothing is binned; the fit is drawn on its window."""
  forces = ReadTable(arguments.forces, ("particles", "kind", "force"), words=("kind",))
  gaps = ReadTable(arguments.gaps, ("particles", "gap"))
  fits = ReadTable(arguments.table, ("particles", "quantity", "samples", "blur", "low",
                                     "high", "exponent", "error", "literature"),
                   words=("quantity",))
  sizes = sorted(set(forces["particles"].astype(int)) | set(gaps["particles"].astype(int)))
  if not sizes:
    raise InputError("%s: no rows" % arguments.forces)
  colours = SizeColours(sizes)
  kind = np.array(forces["kind"])
  quantity = np.array(fits["quantity"])
  theory = dict(theta_localized=0.17462, theta_extended=0.42311, gamma=0.41269)
  panels = {
      "theta_localized": (forces["particles"][kind == "localized"],
                          forces["force"][kind == "localized"]),
      "theta_extended": (forces["particles"][kind == "extended"],
                         forces["force"][kind == "extended"]),
      "gamma": (gaps["particles"], gaps["gap"])}
  width, height = 14.4, 6.1
  figure, axes = plt.subplots(
      1, 3, squeeze=False, figsize=(width, height),
      gridspec_kw=dict(left=0.85 / width, right=1 - 0.3 / width, top=1 - 0.45 / height,
                       bottom=1.3 / height, wspace=0.2))
  for ax, (name, title, label, symbol, sign) in zip(axes[0], QUANTITIES):
    of, values = panels[name]
    good = values > 0
    of, values = of[good], values[good]
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_title(title, loc="left", pad=7)
    ax.set_xlabel(label)
    slope = 1 + sign * theory[name]
    mine = {int(fits["particles"][k]): k for k in np.nonzero(quantity == name)[0]}
    # The fit that is drawn is that of the most samples.
    drawn = max(mine, key=lambda size: (fits["samples"][mine[size]], size), default=None)
    lowest, shown, lines = 1.0, [], []
    for size in sizes:
      # What is blurred by the distance to jamming is left out.
      least = fits["blur"][mine[size]] if size in mine else 0.0
      x = np.sort(values[(of == size) & (values >= least)])
      if not len(x):
        continue
      y = np.arange(1, len(x) + 1) / len(x)
      lowest = min(lowest, y[0])
      shown.append(x)
      ax.plot(x, y, color=colours[size], linewidth=1.5, drawstyle="steps-post",
              zorder=4 if size == drawn else 3)
      text = r"$N = %d$" % size
      if size in mine:
        text += ":  $%s = %s$" % (symbol, WithError(fits["exponent"][mine[size]],
                                                   fits["error"][mine[size]]))
      lines.append((colours[size], text))
    if not shown:
      ax.text(0.5, 0.5, "none", transform=ax.transAxes, ha="center", color=GREY)
      continue
    x_low, x_high = Span(np.concatenate(shown))
    low, high = Span(np.array([lowest, 1.0]))
    ax.set_xlim(10**x_low, 10**x_high)
    ax.set_ylim(10**low, 10**high)
    Decades(ax.xaxis, x_low, x_high)
    Decades(ax.yaxis, low, high)
    if drawn is not None:
      k = mine[drawn]
      s, least, end = 1 + sign * fits["exponent"][k], fits["low"][k], fits["high"][k]
      x = values[(of == drawn) & (values >= fits["blur"][k])]
      below, upto = np.mean(x < least), np.mean(x <= end)
      t = np.geomspace(max(least, x.min()), end, 200)
      if abs(s) > 1e-6:
        rise = (t**s - least**s) / (end**s - least**s)
        # From half a contact on: an empty beginning has no logarithm.
        ax.plot(t, np.maximum(below, 0.5 / len(x)) * (1 - rise) + upto * rise, color=INK, linewidth=2.0,
                linestyle=(0, (3, 1.5)), zorder=5)
      # The slope of the theory, below the data.
      end, top = math.log10(end), math.log10(upto) - 0.085 * (high - low)
      start = max(x_low, end - (top - low) / slope)
      ax.plot([10**start, 10**end], [10**(top + slope * (start - end)), 10**top],
              color=GREY, linewidth=1.4, zorder=2)
    ax.text(0.965, 0.045, r"grey: slope $1 %s %s = %.3f$" %
            ("+" if sign > 0 else "-", symbol, slope), transform=ax.transAxes,
            ha="right", color=GREY, fontsize=11)
    for k, (colour, text) in enumerate(lines):
      ax.text(0.04, 0.955 - 0.068 * k, text, transform=ax.transAxes, color=colour,
              fontsize=11, va="top", zorder=6,
              bbox=dict(boxstyle="square,pad=0.12", facecolor="white", alpha=0.85,
                        linewidth=0))
  FinishPanels(axes)
  axes[0, 0].set_ylabel("part of all that are smaller")
  ReadingHelp(figure, "Cumulative distributions of contact forces over their mean and of gaps "
              "between grains that nearly touch; dashed: the power law of most likelihood, "
              "on the part that it fits best, the exponent with its error in units of the "
              "last digit. Grey: the slope that mean-field theory predicts; the steps at the far "
              "left are single contacts and say little.")
  return figure


# ---------------------------------------------------------------- granular flow


def ReadFrame(path):
  """The first frame of an extended XYZ file of `flow`: time, side, centres, radii,
  velocities."""
  lines = ReadText(path).splitlines()
  try:
    count = int(lines[0])
    values = {key: quoted or plain for key, quoted, plain in
              re.findall(r'(\w+)=(?:"([^"]*)"|(\S+))', lines[1])}
    side = float(values["Lattice"].split()[0])
    time = float(values["Time"])
    rows = np.array([[float(word) for word in line.split()[1:8]]
                     for line in lines[2:2 + count]]).reshape(count, 7)
  except (IndexError, KeyError, ValueError):
    raise InputError("%s: not a frame of spheres with velocities" % path)
  if count < 1 or not np.isfinite(rows).all():
    raise InputError("%s: no grain, or a number that is not finite" % path)
  return time, side, rows[:, :3], rows[:, 3], rows[:, 4:7]


def FlowStartFigure(arguments):
  """Spheres in their cube, seen from the front, right and above; the colour is the
  velocity along the mean flow."""
  time, side, x, radii, v = ReadFrame(arguments.frame)
  azimuth, elevation = math.radians(-62), math.radians(22)
  right = np.array([-math.sin(azimuth), math.cos(azimuth), 0])
  towards = np.array([math.cos(elevation) * math.cos(azimuth),
                      math.cos(elevation) * math.sin(azimuth), math.sin(elevation)])
  up = np.cross(towards, right)
  figure = plt.figure(figsize=(7.4, 6.3))
  ax = figure.add_axes((0.0, 0.0, 0.84, 0.95))
  h = 0.5 * side
  corners = np.array(list(itertools.product((-h, h), repeat=3)))
  hidden = corners[np.argmin(corners @ towards)]
  edges = [(a, b) for a, b in itertools.combinations(corners, 2)
           if np.isclose(np.abs(a - b).sum(), side)]
  for a, b in edges:
    back = np.allclose(a, hidden) or np.allclose(b, hidden)
    ax.plot([a @ right, b @ right], [a @ up, b @ up], color=GREY if back else INK,
            linewidth=0.8 if back else 1.0, linestyle=(0, (4, 3)) if back else "-",
            zorder=0 if back else 3, alpha=1.0 if back else 0.55)
  speed = v[:, 0]
  low, high = speed.min(), speed.max()
  if not high > low:
    low, high = low - 1.0, high + 1.0
  colours = matplotlib.colors.LinearSegmentedColormap.from_list(
      "flow", ["#2B5C8A", "#6FA8D0", "#E9E4D4", "#E8A15B", "#B5401F"])
  depth = x @ towards
  order = np.argsort(depth, kind="stable")
  shades = 7 if len(x) <= 2000 else 1
  span = max(np.ptp(depth), 1e-300)
  light = np.array((-0.32, 0.38))
  patches, fills = [], []
  for i in order:
    centre = np.array((x[i] @ right, x[i] @ up))
    base = np.array(matplotlib.colors.to_rgb(colours((speed[i] - low) / (high - low))))
    base = base + (1 - base) * 0.35 * (1 - (depth[i] - depth.min()) / span)
    for s in range(shades):
      t = s / shades
      patches.append(Circle(centre + light * radii[i] * t, radii[i] * (1 - t)))
      fills.append(np.clip(base * (0.62 + 0.38 * min(1, 1.6 * t)) +
                           0.55 * max(0, t - 0.55) * (1 - base), 0, 1))
  collection = matplotlib.collections.PatchCollection(patches, facecolors=fills,
                                                      edgecolors="none", zorder=2)
  ax.add_collection(collection)
  reach = side * 0.82
  ax.set_xlim(-reach, reach)
  ax.set_ylim(-reach, reach)
  ax.set_aspect("equal")
  ax.axis("off")
  ax.set_title("%d spheres at $t$ = %g s" % (len(x), time), loc="left", x=0.08)
  bar_ax = figure.add_axes((0.865, 0.24, 0.024, 0.5))
  bar = figure.colorbar(matplotlib.cm.ScalarMappable(
      matplotlib.colors.Normalize(low, high), colours), cax=bar_ax)
  bar.set_label("velocity along $x$ / m s$^{-1}$")
  return figure


FLOW_VARIANTS = (("constant_e", "$x \\to -x$, $e$ = 0.5", BLUE),
                 ("velocity_dependent_e", "$x \\to -x$, $e$ of (5.13)", ORANGE),
                 ("nearest_image", "nearest image, $e$ = 0.5", GREEN))
FLOW_STRENGTHS = ("no near field", r"$\bar\alpha$ = 0.1, 0.05",
                  r"$\bar\alpha$ = 0.25, 0.125", r"$\bar\alpha$ = 0.5, 0.25")


def FlowTable(path):
  table = ReadTable(path, ("variant", "strength", "time", "kinetic", "kinetic_deviation",
                           "relative_fraction", "relative_fraction_deviation", "boundary",
                           "boundary_deviation", "first_kinetic",
                           "first_relative_fraction"), words=("variant",))
  if not table["variant"]:
    raise InputError("%s: no rows" % path)
  return table, np.array(table["variant"])


def FlowPanels(height=7.4, bottom=1.25):
  width = 10.4
  figure, axes = plt.subplots(
      2, 2, sharex=True, figsize=(width, height),
      gridspec_kw=dict(left=0.85 / width, right=1 - 0.25 / width, top=1 - 0.4 / height,
                       bottom=bottom / height, wspace=0.16, hspace=0.2))
  for number, ax in enumerate(axes.flat):
    ax.set_title("(%d)  %s" % (number + 1, FLOW_STRENGTHS[number]), loc="left", pad=6)
    ax.grid(True, color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)
    if number > 1:
      ax.set_xlabel("time / s")
  return figure, axes.flat


def Band(ax, x, mean, deviation, colour, label, dashes="-"):
  ax.fill_between(x, mean - deviation, mean + deviation, color=colour, alpha=0.22,
                  linewidth=0)
  ax.plot(x, mean, color=colour, linewidth=1.9, label=label, linestyle=dashes)


def FlowFractionsFigure(arguments):
  """Figure 5: parts of bulk and relative motion in the kinetic energy."""
  table, variant = FlowTable(arguments.table)
  figure, axes = FlowPanels()
  for number, ax in enumerate(axes):
    k = (variant == "constant_e") & (table["strength"] == number + 1)
    t, f, d = (table[name][k] for name in ("time", "relative_fraction",
                                           "relative_fraction_deviation"))
    Band(ax, t, 1 - f, d, BLUE, "bulk")
    Band(ax, t, f, d, VERMILION, "relative", (0, (5, 1.5)))
    ax.plot(t, table["first_relative_fraction"][k], color=VERMILION, linewidth=0.8)
    ax.plot(t, 1 - table["first_relative_fraction"][k], color=BLUE, linewidth=0.8)
    ax.set_ylim(0, 1)
    ax.set_xlim(0, t.max() if len(t) else 1)
    if number % 2 == 0:
      ax.set_ylabel("part of the kinetic energy")
  axes[0].legend(loc="center right")
  ReadingHelp(figure, "Figure 5 of the paper: parts of the kinetic energy in the motion of the "
              "centre of mass and relative to it, by the strength of the near field. Bands: one "
              "standard deviation of a start; thin: one start. With the strongest field relative "
              "motion dominates: a flow becomes a vibrating ensemble.")
  return figure


def FlowEnergyFigure(arguments):
  """Figure 6: kinetic energy per mass."""
  table, variant = FlowTable(arguments.table)
  figure, axes = FlowPanels()
  for number, ax in enumerate(axes):
    for name, label, colour in FLOW_VARIANTS[:2]:
      k = (variant == name) & (table["strength"] == number + 1)
      t = table["time"][k]
      Band(ax, t, table["kinetic"][k], table["kinetic_deviation"][k], colour, label,
           "-" if name == "constant_e" else (0, (5, 1.5)))
      if name == "constant_e":
        ax.plot(t, table["first_kinetic"][k], color=colour, linewidth=0.8)
    ax.set_xlim(0, t.max() if len(t) else 1)
    if number % 2 == 0:
      ax.set_ylabel("$T$ per mass / J kg$^{-1}$")
  axes[0].legend(loc="upper right")
  ReadingHelp(figure, "Figure 6 of the paper: kinetic energy per mass. Bands: one standard "
              "deviation of a start; thin: one start. It falls without near field, where only "
              "impacts act, and is not monotone with one; a restitution that depends on the "
              "velocity changes little.")
  return figure


def FlowBoundaryFigure(arguments):
  """What the paper's rule at the boundary does to the energy."""
  table, variant = FlowTable(arguments.table)
  figure, axes = FlowPanels()
  for number, ax in enumerate(axes):
    for name, label, colour in (FLOW_VARIANTS[0], FLOW_VARIANTS[2]):
      k = (variant == name) & (table["strength"] == number + 1)
      t = table["time"][k]
      if not k.any():
        continue
      Band(ax, t, table["kinetic"][k], table["kinetic_deviation"][k], colour,
           "$T$, " + label.split(",")[0])
      if name == "constant_e":
        Band(ax, t, table["boundary"][k], table["boundary_deviation"][k], VERMILION,
             "put in by the jumps so far", (0, (5, 1.5)))
    ax.axhline(0, color=GREY, linewidth=0.8)
    ax.set_xlim(0, t.max() if len(t) else 1)
    if number % 2 == 0:
      ax.set_ylabel("energy per mass / J kg$^{-1}$")
  axes[1].legend(loc="center left", fontsize=11)
  ReadingHelp(figure, "The paper's rule x \u2192 \u2212x moves an outgoing grain among others "
              "without images: its potential energy jumps, and most of what the kinetic energy "
              "gains is what these jumps put in. With nearest images a crossing costs nothing, "
              "and the growth is gone.")
  return figure


def FlowRunFigure(arguments):
  """One run: kinetic energy and its parts; the ledger."""
  names = ("time", "kinetic", "bulk", "relative", "potential", "impact", "friction",
           "external", "damping", "boundary", "numerical")
  table = ReadTable(arguments.table, names)
  if not len(table["time"]):
    raise InputError("%s: no rows" % arguments.table)
  width, height = 11.4, 5.3
  figure, axes = plt.subplots(
      1, 2, figsize=(width, height),
      gridspec_kw=dict(left=0.85 / width, right=1 - 0.25 / width, top=1 - 0.4 / height,
                       bottom=1.3 / height, wspace=0.2))
  t = table["time"]
  for name, label, colour, dashes in (("kinetic", "all", INK, "-"), ("bulk", "bulk", BLUE, "-"),
                                      ("relative", "relative", VERMILION, (0, (5, 1.5)))):
    axes[0].plot(t, table[name], color=colour, linestyle=dashes, label=label)
  axes[0].set_title("kinetic energy", loc="left", pad=6)
  axes[0].set_ylim(0, None)
  axes[1].plot(t, table["kinetic"] - table["kinetic"][0], color=INK, linewidth=2.2,
               label="kinetic energy")
  axes[1].plot(t, table["potential"][0] - table["potential"], color=BLUE,
               label="from the potential")
  for name, label, colour, dashes in (
      ("boundary", "boundary", VERMILION, (0, (5, 1.5))),
      ("impact", "impact", GREEN, "-"), ("friction", "friction", "#56B4E9", (0, (1.2, 1.2))),
      ("external", "external", PURPLE, "-"), ("damping", "damping", GREY, "-"),
      ("numerical", "integrator", ORANGE, (0, (6, 1.5, 1.2, 1.5)))):
    if np.abs(table[name]).max() > 0:
      axes[1].plot(t, table[name], color=colour, linestyle=dashes, label=label)
  axes[1].axhline(0, color=GREY, linewidth=0.8)
  axes[1].set_title("where it comes from and goes to", loc="left", pad=6)
  for ax in axes:
    ax.set_xlabel("time / s")
    ax.set_ylabel("energy per mass / J kg$^{-1}$")
    ax.set_xlim(t.min(), max(t.max(), t.min() + 1e-12))
    ax.grid(True, color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)
    ax.legend(loc="best", fontsize=11, frameon=True, framealpha=0.85, edgecolor="none")
  ReadingHelp(figure, "Left: the kinetic energy, of the centre of mass and relative to it. "
              "Right: the change of the kinetic energy is the sum of the other lines, to "
              "roundoff; \u201cintegrator\u201d is what finite steps take out or put in.")
  return figure


FLOW_STEPPERS = {"jacobi": (BLUE, "o"), "gauss_seidel": ("#56B4E9", "v"),
                 "groups": (PURPLE, "<"), "verlet": (VERMILION, "s"), "lbfgs": (GREEN, "^"),
                 "newton": (ORANGE, "D"), "ncg": (GREY, ">")}


FLOW_TRADED_STYLES = {
    "verlet": (VERMILION, "-", "s"), "jacobi": (BLUE, "-", "o"),
    "gauss_seidel": ("#56B4E9", (0, (5, 1.5)), "v"), "groups": (PURPLE, (0, (1.2, 1.2)), "<"),
    "relaxed": (ORANGE, (0, (6, 1.5, 1.2, 1.5)), "D"), "lbfgs": (GREEN, "-", "^")}


def FlowWorkFigure(arguments):
  """Work and precision of the three families of steppers."""
  path = arguments.table
  table = ReadTable(path, ("case", "family", "stepper", "tolerance", "dt", "error", "sweeps",
                           "seconds"), words=("family", "stepper"))
  if not table["stepper"]:
    raise InputError("%s: no rows" % path)
  cases = Unique(table["case"])
  width, height = 11.4, 1.9 + 3.35 * 2
  figure, axes = plt.subplots(
      2, len(cases), sharey=True, squeeze=False, figsize=(width, height),
      gridspec_kw=dict(left=0.95 / width, right=1 - 0.25 / width, top=1 - 0.85 / height,
                       bottom=1.45 / height, wspace=0.08, hspace=0.3))
  stepper = np.array(table["stepper"])
  handles = {}
  for column, case in enumerate(cases):
    for row, (work, label) in enumerate((("sweeps", "evaluations of all forces"),
                                         ("seconds", "CPU time / ms"))):
      ax = axes[row, column]
      for name in Unique(table["stepper"]):
        for tolerance in Unique(table["tolerance"][stepper == name]):
          k = (table["case"] == case) & (stepper == name) & (table["tolerance"] == tolerance)
          if not k.any():
            continue
          colour, marker = FLOW_STEPPERS.get(name, (INK, "x"))
          loose = name == "jacobi" and tolerance > 1e-6
          line, = ax.plot(table[work][k] * (1e3 if row else 1), table["error"][k],
                          color=colour, marker=marker, markersize=5.5, linewidth=1.5,
                          linestyle=(0, (4, 2)) if loose else "-",
                          markerfacecolor="white" if loose else colour)
          handles[name + (", TOL = %g" % tolerance if name == "jacobi" else "")] = line
      ax.set_xscale("log")
      ax.set_yscale("log")
      ax.set_xlabel(label)
      ax.grid(True, color=PALE, linewidth=0.7)
      ax.set_axisbelow(True)
      ax.tick_params(which="both", top=True, right=True)
      if column == 0:
        ax.set_ylabel(r"$|T - T_{\mathrm{exact}}|\,/\,T_{\mathrm{exact}}$")
    axes[0, column].set_title(FLOW_STRENGTHS[int(case) - 1], loc="left", pad=6)
  figure.legend(handles.values(), handles.keys(), loc="upper center", ncol=len(handles),
                fontsize=11, handlelength=2.2, columnspacing=1.3, borderaxespad=0.3)
  ReadingHelp(figure, "Each point is a time step; to the lower left is better. Backward Euler by "
              "any solver is limited by the step, not by the tolerance of its iteration: the "
              "dashed line with TOL = 1e-4 is as accurate as the others and cheaper. Verlet "
              "reaches the same error with two to thirteen times fewer evaluations, until "
              "contacts, which every stepper looks for once a step, limit it, too.", left=0.95)
  return figure


def FlowRemarkFigure(arguments):
  """Which solver still solves an implicit step, and for how much."""
  path = arguments.table
  table = ReadTable(path, ("dt", "method", "solved", "attempts", "evaluations", "indefinite"),
                    words=("method",))
  methods = Unique(table["method"])
  if not methods:
    raise InputError("%s: no rows" % path)
  width, height = 11.4, 5.4
  figure, axes = plt.subplots(
      1, 2, figsize=(width, height),
      gridspec_kw=dict(left=0.85 / width, right=1 - 0.25 / width, top=1 - 0.75 / height,
                       bottom=1.3 / height, wspace=0.2))
  method = np.array(table["method"])
  for name in methods:
    k = method == name
    colour, marker = FLOW_STEPPERS.get(name, (BLUE, "o"))
    dashes = (0, (4, 2)) if "," in name else "-"
    label = name.replace("gamma", r"$\gamma$")
    dt = table["dt"][k]
    axes[0].plot(dt, table["solved"][k] / table["attempts"][k], color=colour, marker=marker,
                 linestyle=dashes, markersize=5.5, label=label)
    good = table["solved"][k] > 0
    axes[1].plot(dt[good], table["evaluations"][k][good], color=colour, marker=marker,
                 linestyle=dashes, markersize=5.5)
  k = method == methods[0]
  axes[0].plot(table["dt"][k], table["indefinite"][k] / table["attempts"][k], color=INK,
               linewidth=1.0, linestyle=(0, (1.2, 1.2)), label="tangent not positive definite")
  axes[0].set_ylabel("part of the steps solved")
  axes[0].set_ylim(-0.03, 1.05)
  axes[1].set_ylabel("evaluations of all forces")
  axes[1].set_yscale("log")
  for ax in axes:
    ax.set_xscale("log")
    ax.set_xlabel(r"$\Delta t$ / s")
    ax.grid(True, color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)
  handles, labels = axes[0].get_legend_handles_labels()
  figure.legend(handles, labels, loc="upper center", ncol=4, fontsize=11, borderaxespad=0.3)
  ReadingHelp(figure, "One implicit step of length \u0394t, by fixed point and by minimization of "
              "the incremental potential, impacts frozen. The fixed point is a contraction for "
              "short steps only; lbfgs, ncg and newton (all at 1 on the left) need no "
              "contraction and no positive definite tangent, and go on where the others fail. "
              "Right: medians of the steps that were solved.")
  return figure


def FlowOscillatorFigure(arguments):
  """Free decay and forced response of a grain near its equilibrium."""
  decay = ReadTable(arguments.decay, ("zeta", "time", "measured", "linear"))
  response = ReadTable(arguments.response, ("zeta", "force", "frequency", "amplitude", "phase",
                                            "linear_amplitude", "linear_phase"))
  if not len(decay["zeta"]) or not len(response["zeta"]):
    raise InputError("%s: no rows" % arguments.response)
  width, height = 12.6, 5.3
  figure, axes = plt.subplots(
      1, 3, figsize=(width, height),
      gridspec_kw=dict(left=1.0 / width, right=1 - 0.25 / width, top=1 - 0.4 / height,
                       bottom=1.3 / height, wspace=0.26))
  for zeta, colour in zip(Unique(decay["zeta"]), (BLUE, VERMILION, GREEN, ORANGE)):
    k = decay["zeta"] == zeta
    axes[0].plot(decay["time"][k], decay["linear"][k], color=colour, linewidth=1.4,
                 label=r"$\zeta$ = %g" % zeta)
    axes[0].plot(decay["time"][k][::12], decay["measured"][k][::12], "o", color=colour,
                 markersize=3.6)
  axes[0].set_title("free decay", loc="left", pad=6)
  axes[0].set_xlabel(r"time $\omega^*/2\pi$")
  axes[0].set_ylabel(r"$(r - r^*)\,/\,(r - r^*)_{t=0}$")
  axes[0].legend(loc="upper right")
  forces = Unique(response["force"])
  for zeta, colour in zip(Unique(response["zeta"]), (BLUE, VERMILION, GREEN)):
    for force in forces:
      k = (response["zeta"] == zeta) & (response["force"] == force)
      x = response["frequency"][k]
      small = force == min(forces)
      marker = "o" if small else "x"
      if small:
        for ax, name in ((axes[1], "linear_amplitude"), (axes[2], "linear_phase")):
          fine = np.linspace(x.min(), x.max(), 400)
          if name == "linear_amplitude":
            y = 1 / np.sqrt((1 - fine**2)**2 + (2 * zeta * fine)**2)
          else:
            y = np.arctan2(2 * zeta * fine, 1 - fine**2)
          ax.plot(fine, y, color=colour, linewidth=1.4, label=r"$\zeta$ = %g" % zeta)
      axes[1].plot(x, response["amplitude"][k], marker, color=colour, markersize=4.6)
      axes[2].plot(x, response["phase"][k], marker, color=colour, markersize=4.6)
  axes[1].set_title("forced: amplitude (7.7)", loc="left", pad=6)
  axes[1].set_ylabel(r"$R\,k\,/\,f_0$")
  axes[1].legend(loc="upper right")
  axes[2].set_title("phase (7.8)", loc="left", pad=6)
  axes[2].set_ylabel(r"$\phi$")
  axes[2].set_yticks((0, math.pi / 2, math.pi), labels=("0", r"$\pi/2$", r"$\pi$"))
  for ax in axes[1:]:
    ax.set_xlabel(r"$\Omega\,/\,\omega^*$")
  for ax in axes:
    ax.grid(True, color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)
  ReadingHelp(figure, "One grain about a pinned one, (\u03b1\u2081, \u03b1\u2082) = (0.5, 0.25). "
              "Lines: the linearized equation (7.10); dots: measured in the flow, for "
              "f\u2080/k = 1e-6; crosses: for f\u2080/k = 0.02, 4 % of r*, where the "
              "well is felt to be soft on its outer side and the resonance bends to lower "
              "frequencies.", left=1.0)
  return figure


def FlowThroughputFigure(arguments):
  """Cost of one evaluation of the near field."""
  path = arguments.table
  table = ReadTable(path, ("particles", "what", "seconds", "ns_per_ordered_pair", "error"),
                    words=("what",))
  if not table["what"]:
    raise InputError("%s: no rows" % path)
  what = np.array(table["what"])
  width, height = 11.4, 5.3
  figure, axes = plt.subplots(
      1, 2, figsize=(width, height),
      gridspec_kw=dict(left=0.85 / width, right=1 - 0.25 / width, top=1 - 0.4 / height,
                       bottom=1.3 / height, wspace=0.22))
  styles = (("plain", "plain loop", GREY, "s"), ("vectorized", "all pairs, vectorized", BLUE, "o"),
            ("tree_1e-2", r"multipoles, bound $10^{-2}$", ORANGE, "v"),
            ("tree_1e-3", r"multipoles, bound $10^{-3}$", GREEN, "^"),
            ("tree_1e-4", r"multipoles, bound $10^{-4}$", PURPLE, "D"),
            ("verlet_step", "a step of Verlet, contacts and all", VERMILION, "x"))
  for name, label, colour, marker in styles:
    k = what == name
    if not k.any():
      continue
    axes[0].plot(table["particles"][k], table["seconds"][k], color=colour, marker=marker,
                 markersize=5.5, label=label)
    if name != "verlet_step":
      axes[1].plot(table["particles"][k], table["ns_per_ordered_pair"][k], color=colour,
                   marker=marker, markersize=5.5)
  axes[0].set_yscale("log")
  axes[0].set_ylabel("CPU time / s")
  axes[0].legend(loc="upper left", fontsize=11)
  axes[1].set_ylabel("ns per ordered pair")
  axes[1].set_yscale("log")
  for ax in axes:
    ax.set_xscale("log")
    ax.set_xlabel("grains  $n$")
    ax.grid(True, color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)
  ReadingHelp(figure, "One evaluation of the attraction and repulsion with exponents 1 and 2 on "
              "one thread. The 1/d attraction has no range beyond which it could be cut off; fast "
              "multipoles keep a bound on the error of every force, relative to the magnitudes of "
              "its pair forces. A step of Verlet has two evaluations where a grain crossed the "
              "boundary: nearly every step of many grains.")
  return figure


# ---------------------------------------------------------------- identification


def IdentifyPanels(count, columns, width, height, bottom=1.25, top=0.4, left=0.85):
  rows = -(-count // columns)
  figure, axes = plt.subplots(
      rows, columns, squeeze=False, figsize=(width, height),
      gridspec_kw=dict(left=left / width, right=1 - 0.25 / width, top=1 - top / height,
                       bottom=bottom / height, wspace=0.28, hspace=0.32))
  for ax in axes.flat:
    ax.grid(True, color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)
  return figure, list(axes.flat)


def IdentifyConvergenceFigure(arguments):
  """Figure 7: the best value after each list of strings."""
  table = ReadTable(arguments.table, ("list", "strings", "best", "list_mean", "fresh",
                                      "fresh_error"))
  if not len(table["list"]):
    raise InputError("%s: no rows" % arguments.table)
  figure, (ax,) = IdentifyPanels(1, 1, 7.6, 5.6)
  x = table["list"]
  ax.step(x, table["best"], where="post", color=BLUE, label="best, as the search reports it")
  ax.plot(x, table["best"], "o", color=BLUE, markersize=4)
  known = np.isfinite(table["fresh"])
  ax.errorbar(x[known], table["fresh"][known], 1.96 * table["fresh_error"][known],
              color=VERMILION, marker="s", markersize=4.5, linestyle=(0, (5, 1.5)), capsize=2.5,
              label="the same strings on fresh starts (95 %)")
  top = max(table["best"].max(), (table["fresh"] + 1.96 * table["fresh_error"])[known].max()
            if known.any() else 0)
  ax.set_ylim(0, 1.12 * top)
  ax.set_xlim(-0.3, x.max() + 0.3 if x.max() > 0 else 1)
  ax.xaxis.set_major_locator(matplotlib.ticker.MaxNLocator(integer=True))
  ax.set_xlabel("generation" if len(x) <= 60 else "list of strings")
  ax.set_ylabel("$P$ of the best string")
  ax.legend(loc="upper right")
  ReadingHelp(figure, "Figure 7 of the paper: the least value so far. It is a mean over few "
              "starts, picked as the least of many: on starts that the search has not seen the "
              "same strings do worse, and later gains may be none.")
  return figure


def IdentifyResponseFigure(arguments):
  """Figure 8: the energies that the best string makes, and the target."""
  names = ["time"]
  for part in ("T", "T_b", "T_r"):
    names += [part, part + "_deviation", part + "_first", part + "_target"]
  table = ReadTable(arguments.table, names)
  if not len(table["time"]):
    raise InputError("%s: no rows" % arguments.table)
  figure, axes = IdentifyPanels(3, 3, 12.6, 4.9)
  t = table["time"]
  for ax, part, label, colour in zip(
      axes, ("T", "T_b", "T_r"), ("all, $T$", "bulk, $T_b$", "relative, $T_r$"),
      (INK, BLUE, VERMILION)):
    Band(ax, t, table[part], table[part + "_deviation"], colour, "mean")
    ax.plot(t, table[part + "_first"], color=colour, linewidth=0.8, label="one start")
    ax.plot(t, table[part + "_target"], color=GREEN, linestyle=(0, (5, 1.5)), label="target")
    ax.set_title(label, loc="left", pad=6)
    ax.set_xlim(t.min(), t.max())
    ax.set_ylim(0, 1.12 * max((table[part] + table[part + "_deviation"]).max(),
                              table[part + "_target"].max()))
    ax.set_xlabel("time / s")
  axes[0].set_ylabel("energy per mass / J kg$^{-1}$")
  axes[0].legend(loc="lower right", fontsize=11)
  ReadingHelp(figure, "Figure 8 of the paper: kinetic energy per mass with the identified "
              "parameters, of all motion, of the centre of mass and relative to it, mean and "
              "standard deviation over 20 starts. Every start begins away from the target; the area "
              "between is a floor of $P$.")
  return figure


def Parameters(path, known):
  """Names of columns that are parameters: those between the known first and the first of
  the known others."""
  line = ReadText(path).splitlines()[:1]
  names = [name.strip() for name in line[0].split(",")] if line else []
  return [name for name in names if name not in known]


def IdentifyValleyFigure(arguments):
  """Pairs of parameters: every string of the search, and those that are equally good."""
  fresh_known = ("origin", "reported", "fresh", "fresh_error", "above_best",
                 "above_best_error", "equal")
  names = Parameters(arguments.table, fresh_known)
  if not names:
    raise InputError("%s: no parameters" % arguments.table)
  fresh = ReadTable(arguments.table, (*fresh_known, *names), words=("origin",))
  every = ReadTable(arguments.strings, ("stage", "mean", *names), words=("stage",))
  origin = np.array(fresh["origin"])
  own = (origin == "search") | (origin == "gradient")
  searched = np.array(every["stage"]) == "search"
  value = every["mean"]
  searched &= np.isfinite(value)
  pairs = list(itertools.combinations(names, 2)) or [(names[0], names[0])]
  columns = min(3, len(pairs))
  rows = -(-len(pairs) // columns)
  height = 3.5 * rows + 1.7
  figure, axes = IdentifyPanels(len(pairs), columns, 4.1 * columns + 0.6, height, 1.35)
  low = value[searched].min() if searched.any() else 0.0
  norm = matplotlib.colors.LogNorm(low, max(10 * low, low + 1e-12)) if low > 0 else None
  shades = matplotlib.colors.LinearSegmentedColormap.from_list(
      "valley", ["#173F5F", "#5E9BC8", "#C9D6DF", "#ECECEC"])
  order = np.argsort(-value[searched], kind="stable")
  marks = None
  for ax in axes[len(pairs):]:
    ax.set_visible(False)
  for ax, (a, b) in zip(axes, pairs):
    marks = ax.scatter(every[a][searched][order], every[b][searched][order],
                       c=value[searched][order], cmap=shades, norm=norm, s=20, linewidths=0)
    equal = own & (fresh["equal"] > 0)
    ax.scatter(fresh[a][equal], fresh[b][equal], facecolors="none", edgecolors=VERMILION,
               s=62, linewidths=1.5, label="not told from the best")
    table = np.array([word.startswith("Table") for word in fresh["origin"]])
    if table.any():
      ax.scatter(fresh[a][table], fresh[b][table], marker="x", color=ORANGE, s=44,
                 linewidths=1.8, label="Table 1 of the paper")
    known = origin == "known"
    if known.any():
      ax.scatter(fresh[a][known], fresh[b][known], marker="*", color=GREEN, s=170,
                 label="known")
    best = np.flatnonzero(own)[:1]
    ax.scatter(fresh[a][best], fresh[b][best], marker="+", color=INK, s=90, linewidths=1.8,
               label="best")
    ax.set_xlabel(a)
    ax.set_ylabel(b)
  axes[0].legend(loc="best", fontsize=9.5, frameon=True, framealpha=0.85, edgecolor="none")
  if marks is not None:
    figure_width = figure.get_size_inches()[0]
    bar_ax = figure.add_axes((1 - 2.6 / figure_width, 0.62 / height, 2.2 / figure_width,
                              0.12 / height))
    bar = figure.colorbar(marks, cax=bar_ax, orientation="horizontal", extend="max")
    bar.set_label("$P$ in the search", fontsize=10)
    if norm is not None:
      bar.ax.minorticks_off()
      ticks = [low * factor for factor in (1, 2, 5, 10)]
      bar.set_ticks(ticks, labels=["%.2g" % tick for tick in ticks])
    bar.ax.tick_params(labelsize=9)
  help_width = figure.get_size_inches()[0] - 3.0
  lines = textwrap.wrap("Strings of the search by two of their parameters. Red rings: strings "
                        "that fresh starts do not tell from the best. Where they lie along a "
                        "line only a combination of the two parameters is determined, and no "
                        "number of either.", int(13.2 * (help_width - 0.95)))
  figure.text(0.85 / figure.get_size_inches()[0], 0.14 / height, "\n".join(lines), fontsize=10,
              color=GREY, va="bottom", linespacing=1.45)
  return figure


def IdentifyProfileFigure(arguments):
  """The least value at fixed values of each parameter."""
  known = ("parameter", "P", "error", "best", "best_error")
  table = ReadTable(arguments.table, (*known, "value"), words=("parameter",))
  parameter = np.array(table["parameter"])
  names = Unique(table["parameter"])
  if not names:
    raise InputError("%s: no rows" % arguments.table)
  columns = min(4, len(names))
  rows = -(-len(names) // columns)
  figure, axes = IdentifyPanels(len(names), columns, 3.1 * columns + 1.0, 3.3 * rows + 1.6)
  finite = np.isfinite(table["P"])
  top = min(table["P"][finite].max(), 4 * table["best"][0]) if finite.any() else 1
  for ax in axes[len(names):]:
    ax.set_visible(False)
  for ax, name in zip(axes, names):
    k = parameter == name
    best, error = table["best"][0], 1.96 * table["best_error"][0]
    ax.axhspan(best - error, best + error, color=GREEN, alpha=0.18, linewidth=0)
    ax.axhline(best, color=GREEN, linewidth=1.2, linestyle=(0, (5, 1.5)))
    ax.errorbar(table["value"][k], table["P"][k], 1.96 * table["error"][k], color=BLUE,
                marker="o", markersize=5, capsize=2.5)
    ax.set_ylim(0, 1.1 * top)
    ax.set_xlabel(name)
  axes[0].set_ylabel("least $P$, others free")
  ReadingHelp(figure, "The least value that was found with one parameter held fixed and the "
              "others searched, on 20 fresh starts (95 %); green: the best of all. A parameter "
              "is determined only as far as its curve leaves the green band.")
  return figure


def IdentifyAlternativesFigure(arguments):
  """Searches with as many runs: what they report and what fresh starts say."""
  table = ReadTable(arguments.table, ("method", "runs", "reported", "fresh", "fresh_error"),
                    words=("method",))
  method = np.array(table["method"])
  names = Unique(table["method"])
  if not names:
    raise InputError("%s: no rows" % arguments.table)
  height = 0.52 * len(names) + 2.2
  figure, (ax,) = IdentifyPanels(1, 1, 9.4, height, left=2.6)
  for y, name in enumerate(names):
    k = method == name
    ax.plot(table["reported"][k], np.full(k.sum(), y), "o", markerfacecolor="none",
            color=BLUE, label="reported" if y == 0 else None)
    ax.errorbar(table["fresh"][k], y + 0.12 * (np.arange(k.sum()) - (k.sum() - 1) / 2),
                xerr=1.96 * table["fresh_error"][k], fmt="s", color=VERMILION, markersize=5,
                capsize=2.5, label="on fresh starts (95 %)" if y == 0 else None)
  ax.set_yticks(range(len(names)), names)
  ax.set_ylim(len(names) - 0.4, -0.9)
  ax.set_xlim(0, None)
  ax.set_xlabel("$P$ of the best string")
  ax.legend(loc="upper left", ncol=2, fontsize=11)
  ReadingHelp(figure, "The best string of each search, all with the same number of simulations: "
              "the mean that the search saw and the mean on starts that none has seen. "
              "Searches whose bars overlap are not told apart.")
  return figure


# ---------------------------------------------------------------- output


# ---------------------------------------------------------------- shear


SHEAR_QUANTITIES = (
    ("stress_iso", r"isotropic stress  $\sigma_{\mathrm{iso}}$"),
    ("fabric_iso", r"isotropic fabric  $F_{\mathrm{iso}}$"),
    ("stress_dev", r"deviatoric stress  $\sigma_{\mathrm{dev}}$"),
    ("fabric_dev", r"deviatoric fabric  $F_{\mathrm{dev}}$"))
STRAIN_LABELS = {
    "pure": r"pure shear strain  $\gamma$ / %",
    "simple": r"shear strain  $\gamma$ / %",
    "bulk": r"volume strain  $V / V_0 - 1$ / %"}
FIG8_HELP = (
    "Half the sum and half the difference of the extreme eigenvalues of stress (10) and "
    "fabric (2), as in Fig. 8 of Wang and Zhang; one line for each increment of strain.",
    "Where the lines are one, the increment does not matter; after a rearrangement that "
    "one of them takes differently they are curves of different packings.")
BAND_HELP = ("Lines are means over the packings, bands reach from the 20 to the 80 % "
             "quantile.",)


def IncrementColours(increments):
  order = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, INK, GREY)
  finest_first = sorted(set(increments))
  return {value: order[k % len(order)] for k, value in enumerate(finest_first)}


def TimesTen(values):
  """A power of ten to divide by, and how it is written on an axis."""
  most = np.nanmax(np.abs(values)) if len(values) else 0.0
  exponent = math.floor(math.log10(most)) if most > 0 else 0
  if abs(exponent) <= 1:
    return 1.0, ""
  return 10.0**exponent, r" / $10^{%d}$" % exponent


def StrainFigure(arguments):
  path = arguments.table
  quantities = (SHEAR_QUANTITIES if arguments.first == "stress_iso" else
                (("phi", r"packing fraction  $\phi$"), *SHEAR_QUANTITIES[1:]))
  names = [name for name, _ in quantities]
  lines = ReadText(path).splitlines()
  bands = bool(lines) and "stress_dev_low" in lines[0]
  required = ["increment", "step", "strain", *names]
  if bands:
    required += ["curves"] + [name + end for name in names for end in ("_low", "_high")]
  table = ReadTable(path, required)
  if not len(table["strain"]):
    raise InputError("%s: no rows" % path)
  # A curve begins at its step 0.
  starts = np.nonzero(table["step"] == 0)[0].tolist() or [0]
  pieces = [slice(a, b) for a, b in zip(starts, starts[1:] + [len(table["step"])])]
  colours = IncrementColours(table["increment"])
  height = 7.4
  figure, axes = plt.subplots(
      2, 2, sharex=True, figsize=(10.6, height),
      gridspec_kw=dict(left=0.09, right=0.98, top=1 - 0.62 / height,
                       bottom=0.68 / height, wspace=0.24, hspace=0.09))
  count = len(pieces)
  for ax, (name, label) in zip(axes.flat, quantities):
    unit, power = TimesTen(table[name])
    for k, piece in enumerate(pieces):
      colour = colours[table["increment"][piece][0]]
      strain = 100 * table["strain"][piece]
      # The finest, last, is wide and below; coarser ones dashed on top.
      finest = k == count - 1
      style = dict(linestyle="-" if finest else ((0, (6, 2)) if k % 2 else (0, (2, 1.5))),
                   linewidth=2.4 if finest and count > 1 else 1.6)
      ax.plot(strain, table[name][piece] / unit, color=colour, zorder=3 + (not finest),
              **style)
      if bands and finest:
        ax.fill_between(strain, table[name + "_low"][piece] / unit,
                        table[name + "_high"][piece] / unit, color=colour, alpha=0.16,
                        linewidth=0, zorder=2)
    ax.set_ylabel(label + power)
    ax.margins(x=0.01)
    ax.yaxis.set_major_locator(ticker.MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
  for ax in axes[1]:
    ax.set_xlabel(STRAIN_LABELS[arguments.mode])
    ax.xaxis.set_major_locator(ticker.MaxNLocator(6, steps=[1, 2, 5, 10]))
  FinishPanels(axes)
  figure.align_ylabels(axes[:, 0])
  figure.align_ylabels(axes[:, 1])
  handles = []
  for k, piece in enumerate(pieces):
    value = table["increment"][piece][0]
    finest = k == count - 1
    handles.append(Line2D(
        [], [], color=colours[value], linewidth=2.4,
        linestyle="-" if finest else ((0, (6, 2)) if k % 2 else (0, (2, 1.5))),
        label=r"$\delta\gamma = %s$" % re.sub(r"\.?0*\\times", r"\\times",
                                               Scientific(value))))
  figure.legend(handles=handles, loc="upper center", ncol=min(5, len(handles)),
                bbox_to_anchor=(0.535, 1.0), fontsize=13, handlelength=2.6,
                borderaxespad=0.35)
  if bands:
    Help(figure, *BAND_HELP[:1], "%d packings." % int(table["curves"].max()), *FIG8_HELP)
  else:
    Help(figure, *FIG8_HELP)
  return figure


EVENT_HELP = (
    "Left, what the grains do at fixed strain as the packing gives way. Right, from "
    "above: the lowest eigenvalue of the Hessian on the branch against the strain that "
    "is left (Hertz: the square root of a saddle-node; Hooke: the Hessian jumps as a "
    "contact opens, and so does the eigenvalue); the energy on the straight way from "
    "before to after; of discs, the angular harmonics of the radial displacement around "
    "the grain that moves most, by distance from it: an elastic inclusion is m = 2.")


def EventFigure(arguments):
  folder = arguments.folder + "/"
  packing = ReadPacking(folder + "event.xyz")
  contacts = ReadContacts(folder + "event_contacts.csv", packing)
  vectors = ReadVectors(folder + "event.xyz", "displacement", packing)
  branch = ReadTable(folder + "event_branch.csv", ("strain_left", "lowest_eigenvalue"))
  way = ReadTable(folder + "event_landscape.csv", ("t", "above_the_end"))
  harmonics = ReadTable(folder + "event_harmonics.csv",
                        ("inner", "outer", "m", "amplitude"))
  side, foot = 6.4, 0.5
  height, foot = Space(packing, side)
  total_width, head = 12.4, 0.45
  total = max(foot + height + head, 6.6)
  figure = plt.figure(figsize=(total_width, total + 0.75))
  lift = 0.75
  view = View(figure, packing, 0.1, lift + foot, side, height)
  if view.d == 2:
    DrawFlat(view, contacts._replace(force=0 * contacts.force),
             lambda: [DrawArrows(view, vectors)])
  else:
    DrawProjection(view, contacts._replace(force=0 * contacts.force))
    DrawArrows(view, vectors)
  Label(figure, 0.1 + side / 2, lift + foot + height + 0.2,
        "     ".join(Describe(packing, contacts)), side, ha="center", fontsize=12)
  Key(figure, view, contacts._replace(force=0 * contacts.force), lift + foot / 2)
  # Key() centres on the figure; under the packing it belongs.
  box = figure.artists[-1]
  box.set_bbox_to_anchor(((0.1 + side / 2) / total_width,
                          (lift + foot / 2) / (total + 0.75)), figure.transFigure)
  left, right = 7.75 / total_width, 0.985
  # Harmonics are those of discs.
  flat = len(harmonics["m"]) > 0
  third = (total - 0.9) / (3 if flat else 2)
  def Panel(k):
    bottom = lift + 0.55 + ((2 if flat else 1) - k) * (third + 0.16)
    return figure.add_axes([left, bottom / (total + 0.75), right - left,
                            (third - 0.42) / (total + 0.75)])
  ax = Panel(0)
  x, y = branch["strain_left"], branch["lowest_eigenvalue"]
  good = (x > 0) & (y > 0)
  if good.any():
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.plot(x[good], y[good], "o-", color=BLUE, markersize=5)
    low, high = Span(x[good])
    Decades(ax.xaxis, low, high)
    low, high = Span(y[good])
    ax.set_ylim(10**low, 10**high)
    Decades(ax.yaxis, low, high)
    if good.sum() > 3:
      end = x[good][-1], y[good][-1]
      line = np.geomspace(x[good].min(), x[good].max(), 2)
      ax.plot(line, end[1] * (line / end[0])**0.5, color=GREY, linestyle=(0, (5, 3)),
              linewidth=1.2, scalex=False, scaley=False)
  ax.set_xlabel("strain left", fontsize=12)
  ax.set_ylabel(r"$\lambda_1 / \kappa$")
  ax = Panel(1)
  unit, power = TimesTen(way["above_the_end"])
  ax.plot(way["t"], way["above_the_end"] / unit, color=VERMILION)
  ax.set_xlabel("part of the way", fontsize=12)
  ax.set_ylabel(r"$E - E_{\mathrm{after}}$" + power)
  if flat:
    ax = Panel(2)
    shells = sorted(set(harmonics["inner"]))
    width = 0.8 / len(shells)
    unit, power = TimesTen(harmonics["amplitude"])
    length = math.sqrt(abs(np.linalg.det(packing.cell)))
    for k, inner in enumerate(shells):
      of = harmonics["inner"] == inner
      ax.bar(harmonics["m"][of] + (k - (len(shells) - 1) / 2) * width,
             harmonics["amplitude"][of] / unit, width,
             color=Mix(BLUE, "#FFFFFF", 0.22 * k),
             label="%.2g" % ((inner + harmonics["outer"][of][0]) / 2 / length))
    ax.set_ylabel("amplitude" + power)
    ax.legend(title="distance / cell", fontsize=9, title_fontsize=9, ncol=2)
    ax.set_xlabel("harmonic $m$", fontsize=12)
  for ax in figure.axes[1:]:
    ax.grid(True, color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True, labelsize=11)
  figure.text(0.1 / total_width, 0.1 / (total + 0.75),
              "\n".join(textwrap.wrap(EVENT_HELP, 168)), fontsize=9.5, color=GREY,
              va="bottom", linespacing=1.25)
  return figure


def EventsFigure(arguments):
  harmonics = ["m%d" % m for m in range(5)]
  table = ReadTable(arguments.table, ("energy", "energy_drop", "stress_drop",
                                      "participation", "strain_before", *harmonics))
  if not len(table["energy"]):
    raise InputError("%s: no rows" % arguments.table)
  figure, axes = plt.subplots(
      1, 3, figsize=(13.6, 4.7), gridspec_kw=dict(
          left=0.065, right=0.985, top=0.9, bottom=0.16, wspace=0.27))
  drop = np.sort(table["energy_drop"] / table["energy"])
  part = 1 - np.arange(len(drop)) / len(drop)
  ax = axes[0]
  ax.set_xscale("log")
  ax.set_yscale("log")
  ax.step(drop, part, where="post", color=BLUE, linewidth=2)
  ax.plot(drop, part, ".", color=BLUE, markersize=4)
  ax.set_xlabel(r"energy drop  $\Delta E / E$")
  ax.set_ylabel("part of the events that are larger")
  ax.set_title("%d events, median %s" % (len(drop), "$%s$" % Scientific(np.median(drop))),
               loc="left", fontsize=12)
  ax = axes[1]
  ax.set_xscale("log")
  ax.set_yscale("log")
  falls = table["stress_drop"] > 0
  for chosen, fill, label in ((falls, BLUE, "stress falls"),
                              (~falls, "white", "stress rises")):
    if chosen.any():
      ax.scatter((table["energy_drop"] / table["energy"])[chosen],
                 table["participation"][chosen], s=26, facecolor=fill,
                 edgecolor=Mix(BLUE, INK, 0.3), linewidth=0.9, label=label)
  ax.set_xlabel(r"energy drop  $\Delta E / E$")
  ax.set_ylabel("participation of the grains")
  ax.legend(fontsize=11, loc="lower right", frameon=True, framealpha=0.9)
  ax = axes[2]
  flat = table["m2"] > 0
  if flat.any():
    shares = [table[name][flat] for name in harmonics]
    for m, share in enumerate(shares):
      low, middle, high = np.quantile(share, (0.25, 0.5, 0.75))
      ax.bar(m, middle, 0.7, color=BLUE if m == 2 else Mix(BLUE, "#FFFFFF", 0.6))
      ax.vlines(m, low, high, color=INK, linewidth=1.4)
    ax.axhline(0.2, color=GREY, linestyle=(0, (5, 3)), linewidth=1.2)
    ax.set_xticks(range(5))
  ax.set_xlabel("harmonic $m$ of the far field")
  ax.set_ylabel("its part")
  FinishPanels(axes)
  Help(figure, "First, the cumulative distribution of the part of its energy that the "
       "packing dissipates in an event at fixed strain. Then, how many grains take part "
       "in it: 1 if all move alike, 1 / N' for a single one; open circles are events after "
       "which the packing resists more than before. Last, medians and quartiles of the angular "
       "harmonics of the radial displacement around the grain that moves most (discs): "
       "an elastic inclusion is m = 2, dashed if all were alike.")
  return figure


def WallsFigure(arguments):
  path = arguments.folder + "/walls.csv"
  table = ReadTable(path, ("strain", "shear_stress", "normal_stress"))
  profile = ReadTable(arguments.folder + "/profile.csv", ("height", "displacement"))
  if not len(table["strain"]):
    raise InputError("%s: no rows" % path)
  figure, axes = plt.subplots(
      1, 3, figsize=(12.4, 4.6), gridspec_kw=dict(
          left=0.07, right=0.985, top=0.95, bottom=0.16, wspace=0.32))
  for ax, name, label in ((axes[0], "shear_stress", r"wall shear stress  $\tau$"),
                          (axes[1], "normal_stress", "wall normal stress  $p$")):
    unit, power = TimesTen(table[name])
    ax.plot(100 * table["strain"], table[name] / unit, color=BLUE)
    ax.set_xlabel(STRAIN_LABELS["simple"])
    ax.set_ylabel(label + power)
  ax = axes[2]
  ax.plot([0, 1], [0, 1], color=GREY, linestyle=(0, (5, 3)), linewidth=1.2)
  ax.plot(profile["displacement"], profile["height"], "o-", color=VERMILION,
          markersize=5)
  ax.set_xlabel("displacement / that of the wall")
  ax.set_ylabel("height / distance of the walls")
  ax.set_ylim(0, 1)
  FinishPanels(axes)
  Help(figure, "What the grains exert on the upper wall, which moves along x, and, right, "
       "how far the grains have followed it at the end: dashed if the shear were even.")
  return figure


def StressFigure(arguments):
  table = ReadTable(arguments.table, ("strain", "shear_stress", "phi", "pressure",
                                      "coordination"))
  if not len(table["strain"]):
    raise InputError("%s: no rows" % arguments.table)
  figure, axes = plt.subplots(
      1, 3, figsize=(12.4, 4.6), gridspec_kw=dict(
          left=0.07, right=0.985, top=0.95, bottom=0.16, wspace=0.36))
  unit, power = TimesTen(table["shear_stress"])
  ax = axes[0]
  ax.plot(100 * table["strain"], table["shear_stress"] / unit, "o-", color=BLUE,
          markersize=4)
  if arguments.yields:
    ax.axhline(arguments.yields / unit, color=VERMILION, linestyle=(0, (5, 3)))
  ax.set_xlabel(STRAIN_LABELS["simple"])
  ax.set_ylabel(r"shear stress  $-\sigma_{12}$" + power)
  # What is held constant has nothing to show.
  at_pressure = np.ptp(table["pressure"]) < 1e-6 * table["pressure"].max()
  if at_pressure:
    values, label = table["phi"], r"packing fraction  $\varphi$"
  else:
    scale, power_y = TimesTen(table["pressure"])
    values, label = table["pressure"] / scale, "pressure  $p$" + power_y
  for ax, y, name in ((axes[1], values, label),
                      (axes[2], table["coordination"], "contacts a grain  $z$")):
    ax.plot(table["shear_stress"] / unit, y, "o-", color=BLUE, markersize=4)
    ax.set_xlabel(r"shear stress  $-\sigma_{12}$" + power)
    ax.set_ylabel(name)
    ax.ticklabel_format(axis="y", useOffset=False)
  FinishPanels(axes)
  Help(figure, "Minima over grains and cell at given shear stress, at constant "
       + ("pressure" if at_pressure else "volume") + ("; dashed: no state was found above." if arguments.yields else "."))
  return figure


def DynamicsFigure(arguments):
  names = (("energy", "$E$"), ("pressure", "$p$"),
           ("stress_dev", r"$\sigma_{\mathrm{dev}}$"),
           ("fabric_iso", r"$F_{\mathrm{iso}}$"),
           ("fabric_dev", r"$F_{\mathrm{dev}}$"), ("coordination", "$z$"))
  table = ReadTable(arguments.table, ("seed", "load", "way", *(n for n, _ in names)),
                    words=("load", "way"))
  if not table["load"]:
    raise InputError("%s: no rows" % arguments.table)
  load, way = np.array(table["load"]), np.array(table["way"])
  loads, ways = Unique(table["load"]), [w for w in Unique(table["way"])
                                        if w != "minimizer"]
  figure, axes = plt.subplots(
      1, len(loads), sharey=True, squeeze=False, figsize=(1.2 + 3.8 * len(loads), 4.9),
      gridspec_kw=dict(left=0.085, right=0.985, top=0.84, bottom=0.13, wspace=0.07))
  colours = (BLUE, VERMILION, GREEN, ORANGE)
  for ax, which in zip(axes[0], loads):
    base = (load == which) & (way == "minimizer")
    order = np.argsort(table["seed"][base])
    ax.axhline(1, color=GREY, linestyle=(0, (5, 3)), linewidth=1.2, zorder=1)
    for k, one in enumerate(ways):
      chosen = (load == which) & (way == one)
      mine = np.argsort(table["seed"][chosen])
      for column, (name, _) in enumerate(names):
        reference = table[name][base][order]
        ratio = table[name][chosen][mine] / np.where(reference > 0, reference, np.nan)
        x = column + (k - (len(ways) - 1) / 2) * 0.22
        ax.plot(np.full(len(ratio), x), ratio, ".", color=Mix(colours[k % 4], "#FFFFFF", 0.5),
                markersize=5, zorder=2)
        error = np.nanstd(ratio, ddof=1) / math.sqrt(len(ratio)) if len(ratio) > 1 else 0
        ax.errorbar([x], [np.nanmean(ratio)], yerr=[error], color=colours[k % 4],
                    marker="o", markersize=6, capsize=3, zorder=4)
    ax.set_title(which, fontsize=12.5, loc="left")
    ax.set_xticks(range(len(names)))
    ax.set_xticklabels([label for _, label in names], fontsize=11)
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter(ticker.FormatStrFormatter("%g"))
    ax.yaxis.set_minor_formatter(ticker.NullFormatter())
  low, high = axes[0, 0].get_ylim()
  # A stress that nearly vanishes says little by its ratio.
  low = max(low, 0.05)
  axes[0, 0].set_ylim(low, high)
  choice = ((0.1, 0.2, 0.5, 1, 2, 5, 10) if high / low > 4 else
            (0.5, 0.7, 0.8, 0.9, 1, 1.1, 1.2, 1.4, 2) if high / low > 1.1 else
            (0.96, 0.98, 1, 1.02, 1.04))
  axes[0, 0].yaxis.set_major_locator(
      ticker.FixedLocator([t for t in choice if low <= t <= high]))
  axes[0, 0].set_ylabel("ratio to the minimizer's")
  FinishPanels(axes)
  figure.legend(handles=[Line2D([], [], color=colours[k % 4], marker="o", linestyle="",
                                markersize=7, label=one.replace("motion c=", "$c = ") + "$")
                         for k, one in enumerate(ways)],
                loc="upper center", ncol=len(ways), bbox_to_anchor=(0.535, 1.0),
                fontsize=12.5, title=None)
  Help(figure, "Damped Newtonian motion from rest, from the same start as the minimizer; "
       "c in units of the root of stiffness times mass. Small points: single packings, "
       "large ones their mean with its standard error.")
  return figure


def Save(figure, base):
  """OUT.svg and OUT.png: written aside, then renamed."""
  written = []
  try:
    for kind in ("svg", "png"):
      # A collection of one disc many times is compact in the SVG, but the PNG
      # would round its places to pixels; two equal values of a property stop that.
      for discs in figure.findobj(EllipseCollection):
        discs.set_antialiased([True] if kind == "svg" else [True, True])
      path = "%s.%s" % (base, kind)
      temporary = "%s.%d.tmp" % (path, os.getpid())
      written.append((temporary, path))
      metadata = {"Creator": "granopt", "Date": None} if kind == "svg" \
          else {"Software": "granopt"}
      picture = io.BytesIO()
      figure.savefig(picture, format=kind, dpi=DPI, metadata=metadata)
      data = picture.getvalue()
      if kind == "svg":
        # matplotlib names clip paths after addresses in memory.
        names = {}
        data = re.sub(rb'(url\(#|id=")(p[0-9a-f]{10})\b', lambda match: match[1] +
                      names.setdefault(match[2], b"clip%d" % len(names)), data)
      with open(temporary, "wb") as file:
        file.write(data)
    for temporary, path in written:
      os.replace(temporary, path)
  except OSError as error:
    raise InputError("%s: %s" % (base, error.strerror or error))
  finally:
    for temporary, _ in written:
      if os.path.exists(temporary):
        os.remove(temporary)


class Parser(argparse.ArgumentParser):

  def error(self, message):
    raise InputError(message)


def Arguments(words):
  parser = Parser(prog="plot.py", description=__doc__,
                  formatter_class=argparse.RawDescriptionHelpFormatter)
  commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
  command = commands.add_parser("packing")
  command.add_argument("packing")
  command.add_argument("contacts")
  command.add_argument("out")
  command.add_argument("--title", default="")
  command.set_defaults(figure=PackingFigure)
  command = commands.add_parser("stages")
  command.add_argument("directory")
  command.add_argument("out")
  command.set_defaults(figure=StagesFigure)
  command = commands.add_parser("mode")
  command.add_argument("packing")
  command.add_argument("contacts")
  command.add_argument("table")
  command.add_argument("out")
  command.add_argument("--number", type=int, default=1)
  command.set_defaults(figure=ModeFigure)
  command = commands.add_parser("path")
  command.add_argument("table")
  command.add_argument("out")
  command.add_argument("--phi_j", type=float)
  command.add_argument("--alpha", type=float, default=2.0)
  command.add_argument("--dimension", type=int, choices=(2, 3), default=2)
  command.set_defaults(figure=PathFigure)
  command = commands.add_parser("trace")
  command.add_argument("table")
  command.add_argument("out")
  command.set_defaults(figure=TraceFigure)
  for name, figure in (("curves", CurvesFigure), ("work", WorkFigure),
                       ("distances", DistancesFigure), ("fig7", Fig7Figure)):
    command = commands.add_parser(name)
    command.add_argument("table")
    command.add_argument("out")
    command.add_argument("--level", action="append", default=[])
    if name == "distances":
      command.add_argument("--steps", default="all")
    elif name != "fig7":
      command.add_argument("--cases", default="")
    command.set_defaults(figure=figure)
  for name, figure in (("profile", ProfileFigure), ("quality", QualityFigure)):
    command = commands.add_parser(name)
    command.add_argument("table")
    command.add_argument("out")
    command.set_defaults(figure=figure)
  command = commands.add_parser("protocol")
  command.add_argument("kind", choices=("jamming", "shear"))
  command.add_argument("data")
  command.add_argument("out")
  command.add_argument("--epsilon", type=float)
  command.add_argument("--reference", default="")
  command.set_defaults(figure=ProtocolFigure)
  command = commands.add_parser("conditioning")
  command.add_argument("table")
  command.add_argument("changes")
  command.add_argument("out")
  command.set_defaults(figure=ConditioningFigure)
  for name, figure in (("ensemble", EnsembleFigure), ("finite_size", FiniteSizeFigure)):
    command = commands.add_parser(name)
    command.add_argument("table")
    command.add_argument("out")
    command.add_argument("--dimension", type=int, choices=(2, 3), default=2)
    if name == "finite_size":
      command.add_argument("--fit", default="")
    command.set_defaults(figure=figure)
  command = commands.add_parser("grain_cost")
  command.add_argument("table")
  command.add_argument("out")
  command.set_defaults(figure=GrainCostFigure)
  command = commands.add_parser("fidelity")
  command.add_argument("table")
  command.add_argument("out")
  command.add_argument("--accuracy", type=float, default=0.05)
  command.set_defaults(figure=FidelityFigure)
  command = commands.add_parser("laws")
  command.add_argument("table")
  command.add_argument("out")
  command.add_argument("--exponents", default="")
  command.set_defaults(figure=LawsFigure)
  for name, figure in (("collapse", CollapseFigure), ("vibrations", VibrationsFigure),
                       ("extremes", ExtremesFigure), ("tradeoff", TradeoffFigure),
                       ("tradeoff_flow", TradeoffFlowFigure),
                       ("phi_j", PhiJFigure)):
    command = commands.add_parser(name)
    command.add_argument("table")
    command.add_argument("out")
    command.set_defaults(figure=figure)
  command = commands.add_parser("distributions")
  command.add_argument("forces")
  command.add_argument("gaps")
  command.add_argument("table")
  command.add_argument("out")
  command.set_defaults(figure=DistributionsFigure)
  for name, figure in (("flow_run", FlowRunFigure), ("flow_fractions", FlowFractionsFigure),
                       ("flow_energy", FlowEnergyFigure),
                       ("flow_boundary", FlowBoundaryFigure), ("flow_work", FlowWorkFigure),
                       ("flow_remark8", FlowRemarkFigure),
                       ("flow_throughput", FlowThroughputFigure)):
    command = commands.add_parser(name)
    command.add_argument("table")
    command.add_argument("out")
    command.set_defaults(figure=figure)
  command = commands.add_parser("flow_start")
  command.add_argument("frame")
  command.add_argument("out")
  command.set_defaults(figure=FlowStartFigure)
  command = commands.add_parser("flow_oscillator")
  command.add_argument("decay")
  command.add_argument("response")
  command.add_argument("out")
  command.set_defaults(figure=FlowOscillatorFigure)
  command = commands.add_parser("shear")
  command.add_argument("table")
  command.add_argument("out")
  command.add_argument("--mode", choices=tuple(STRAIN_LABELS), default="pure")
  command.add_argument("--first", choices=("stress_iso", "phi"), default="stress_iso")
  command.set_defaults(figure=StrainFigure)
  command = commands.add_parser("event")
  command.add_argument("folder")
  command.add_argument("out")
  command.set_defaults(figure=EventFigure)
  command = commands.add_parser("walls")
  command.add_argument("folder")
  command.add_argument("out")
  command.set_defaults(figure=WallsFigure)
  command = commands.add_parser("stress")
  command.add_argument("table")
  command.add_argument("out")
  command.add_argument("--yields", type=float, default=0.0)
  command.set_defaults(figure=StressFigure)
  command = commands.add_parser("dynamics")
  command.add_argument("table")
  command.add_argument("out")
  command.set_defaults(figure=DynamicsFigure)
  command = commands.add_parser("events")
  command.add_argument("table")
  command.add_argument("out")
  command.set_defaults(figure=EventsFigure)
  for name, figure in (("identify_convergence", IdentifyConvergenceFigure),
                       ("identify_response", IdentifyResponseFigure),
                       ("identify_profile", IdentifyProfileFigure),
                       ("identify_alternatives", IdentifyAlternativesFigure)):
    command = commands.add_parser(name)
    command.add_argument("table")
    command.add_argument("out")
    command.set_defaults(figure=figure)
  command = commands.add_parser("identify_valley")
  command.add_argument("table")
  command.add_argument("strings")
  command.add_argument("out")
  command.set_defaults(figure=IdentifyValleyFigure)
  return parser.parse_args(words)


def main():
  try:
    arguments = Arguments(sys.argv[1:])
    matplotlib.rcdefaults()  # no personal style
    matplotlib.rcParams.update(STYLE)
    Save(arguments.figure(arguments), arguments.out)
  except InputError as error:
    sys.stderr.write("plot.py: %s\n" % error)
    return 2
  return 0


if __name__ == "__main__":
  sys.exit(main())
