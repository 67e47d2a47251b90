#!/usr/bin/python3
"""The figures of the experiments, from the files that they write.

    plot.py packing PACKING.xyz CONTACTS.csv OUT [--title=T]
        discs (3D: a projection) with force chains
    plot.py stages DIR OUT
        stage_initial.xyz, stage_unjammed.xyz, packing.xyz + contacts.csv
    plot.py path PATH.csv OUT [--phi_j=PHI] [--alpha=2] [--dimension=2]
        energy, pressure and coordination along a jamming path
    plot.py trace TRACE.csv OUT
        residual against iterations and seconds

Each writes OUT.svg and OUT.png, both or neither. The same input gives the same
bytes. Bad input or usage: one line on stderr, status 2.
"""

import argparse
import csv
import itertools
import math
import os
import re
import sys
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
                                    TextArea)
  from matplotlib.patches import Circle, PathPatch, Polygon, Rectangle
  from matplotlib.path import Path
except ImportError as error:
  sys.stderr.write("plot.py: %s (apt install python3-matplotlib)\n" % error)
  sys.exit(2)

# Colours of Okabe and Ito, which the colour-blind tell apart, and pale fills of
# different lightness.
BLUE, ORANGE, GREEN, VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
INK, GREY, PALE = "#22262B", "#6B737C", "#D9DDE1"
SPECIES_FILLS = ("#BCD6EA", "#F6E7C4", "#CFE6D8", "#E9D3E2")
WEAK, MEAN, STRONG = "#E0906E", "#B5301F", "#5A0713"  # force chains

DPI = 180
MAX_FORCE = 6.0  # of the mean; stronger contacts are drawn as this one
MIN_FORCE = 0.03  # drawn as hairlines below
RASTER_ABOVE = 20000  # grains; the discs of the SVG are then a picture

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


def ReadTable(path, required, words=()):
  """Columns by name: arrays of numbers, lists of strings for those in `words`."""
  rows = list(csv.reader(ReadText(path).splitlines()))
  if not rows:
    raise InputError("%s: empty, expected the columns %s" % (path, ",".join(required)))
  names = [name.strip() for name in rows[0]]
  missing = [name for name in required if name not in names]
  if missing:
    raise InputError("%s:1: no column %s" % (path, ", ".join(missing)))
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
  return rattler


def Pressure(packing, contacts):
  d = packing.positions.shape[1]
  return (np.dot(contacts.force, contacts.distance) /
          (d * abs(np.linalg.det(packing.cell))))


def Coordination(packing, contacts):
  rigid_grains = np.sum(~Rattlers(packing, contacts))
  return 2 * np.sum(contacts.rigid) / rigid_grains if rigid_grains else 0.0


def Scientific(value):
  """3 digits, as mathtext without the dollars."""
  if value == 0:
    return "0"
  if 1e-2 <= abs(value) < 1e4:
    return "%.3g" % value
  mantissa, exponent = ("%.2e" % value).split("e")
  return r"%s\times10^{%d}" % (mantissa, int(exponent))


def Describe(packing, contacts):
  """`N = ...  phi = ...  p = ...  z = ...  rattlers`."""
  words = ["$N = %d$" % len(packing.radii),
           r"$\phi = %.5f$" % PackingFraction(packing)]
  if contacts is not None:
    rattlers = int(Rattlers(packing, contacts).sum())
    words.append("$p = %s$" % Scientific(Pressure(packing, contacts)))
    if rattlers == len(packing.radii):
      words.append("no rigid grains")
    else:
      words.append("$z = %.3f$" % Coordination(packing, contacts))
      words.append("%d rattler%s" % (rattlers, "" if rattlers == 1 else "s"))
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

  Axes are `width` inches wide at most and `height` high at most; left and bottom
  of the space are given in inches.
  """

  def __init__(self, figure, packing, left, bottom, width, height):
    self.packing = packing
    self.d = packing.positions.shape[1]
    cell = packing.cell
    mean_radius = np.mean(packing.radii)
    # Distances between opposite faces, and the border in units of them.
    inverse = np.linalg.inv(cell)
    self.heights = 1 / np.linalg.norm(inverse, axis=0)
    border = min(1.3 * mean_radius, 0.06 * self.heights.min())
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
    self.unit_width = min(0.24 * mean_radius * self.points, 5.0)  # of f = <f>
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
    reach = [range(math.floor(-m - h) , math.ceil(1 + m - l) + 1)
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
  hatched = radius > 7
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
        if np.ptp(diameters) == 0:
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
  strength = contacts.force / np.mean(contacts.force[contacts.force > 0])
  start = view.fractions[contacts.j]
  end = start + (contacts.distance[:, None] * contacts.normal) @ view.inverse
  which, shifts = view.Copies(np.minimum(start, end), np.maximum(start, end))
  drawn = strength[which] > 1e-3
  which, shifts = which[drawn], shifts[drawn]
  cell = view.packing.cell
  ends = np.stack([(start[which] + shifts) @ cell, (end[which] + shifts) @ cell],
                  axis=1)
  level = np.rint(np.log(np.clip(strength[which], MIN_FORCE, MAX_FORCE)) /
                  math.log(1.08)).astype(int)
  depth = np.zeros(len(which), int)
  if view.d == 3:
    depth = Depth(view, (start[which] + end[which]) / 2 + shifts)
  groups = []
  for key in sorted(set(zip(depth.tolist(), level.tolist()))):
    chosen = (depth == key[0]) & (level == key[1])
    groups.append((key[0] / DEPTHS, 1.08**key[1], ends[chosen][:, :, :2]))
  return groups


DEPTHS = 10


def Depth(view, fractions):
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
      capstyle="round", zorder=2))


def DrawFlat(view, contacts):
  rattler = (np.zeros(len(view.packing.radii), bool) if contacts is None
             else Rattlers(view.packing, contacts))
  if rattler.all():
    rattler[:] = False  # unjammed: the word says nothing about a grain
  artists = DrawDiscs(view, rattler)
  groups = ForceGroups(view, contacts)
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


def DepthColour(depth, force):
  del force
  return Mix("#D3DCE4", STRONG, depth**1.3) if depth < 1 else STRONG


def DrawProjection(view, contacts):
  cell, packing = view.packing.cell, view.packing
  rattler = (np.zeros(len(packing.radii), bool) if contacts is None
             else Rattlers(packing, contacts))
  corners = list(itertools.product((0, 1), repeat=3))
  edges = [[np.dot(a, cell)[:2], np.dot(b, cell)[:2]]
           for a, b in itertools.combinations(corners, 2)
           if np.abs(np.subtract(a, b)).sum() == 1]
  view.ax.add_collection(LineCollection(edges, colors=GREY, linewidths=0.8,
                                        zorder=1))
  slices = Depth(view, view.fractions)
  centres = (view.fractions @ cell)[:, :2]
  groups = ForceGroups(view, contacts)
  for level in range(DEPTHS + 1):
    depth = level / DEPTHS
    here = [group for group in groups if group[0] == depth]
    if here:
      Segments(view, here, DepthColour).set_zorder(2 + level)
    for kind in range(len(packing.species[0])):
      for loose in (False, True):
        chosen = ((slices == level) & (packing.species[1] == kind) &
                  (rattler == loose))
        if not chosen.any():
          continue
        fill = SPECIES_FILLS[kind % len(SPECIES_FILLS)]
        size = 0.6 * np.mean(packing.radii[chosen])
        view.ax.add_collection(EllipseCollection(
            [size], [size], [0.0], units="xy", offsets=centres[chosen],
            transOffset=view.ax.transData,
            facecolors="white" if loose else Mix("white", fill, 0.25 + 0.75 * depth),
            edgecolors=Mix("#D3DCE4", INK, depth), linewidths=0.6,
            linestyles=":" if loose else "-", zorder=2.5 + level))


def Draw(view, contacts):
  (DrawFlat if view.d == 2 else DrawProjection)(view, contacts)


def Key(figure, view, contacts, bottom, size=12.5):
  """The legend: species, rattlers, widths of forces; centred `bottom` inches up."""
  packing = view.packing
  text = dict(size=size, color=INK)
  height = 16
  rattler = (np.zeros(len(packing.radii), bool) if contacts is None
             else Rattlers(packing, contacts))
  if rattler.all():
    rattler[:] = False

  def Sample(width, *artists):
    area = DrawingArea(width, height)
    for artist in artists:
      area.add_artist(artist)
    return area

  def Entry(area, label):
    return HPacker(children=[area, TextArea(label, textprops=text)],
                   align="center", pad=0, sep=5)

  entries = []
  names, species = packing.species
  largest = max(np.mean(packing.radii[species == k]) for k in range(len(names)))
  if len(names) <= len(SPECIES_FILLS):
    for k, name in enumerate(names):
      fill = SPECIES_FILLS[k]
      radius = 8 * np.mean(packing.radii[species == k]) / largest
      entries.append(Entry(
          Sample(2 * radius, Circle((radius, height / 2), radius, facecolor=fill,
                                    edgecolor=Mix(fill, INK, 0.45), linewidth=0.8)),
          name.replace("$", r"\$")))
  if rattler.any():
    entries.append(Entry(
        Sample(14, Circle((7, height / 2), 7, facecolor="white", edgecolor=GREY,
                          linewidth=0.8, linestyle="-" if view.d == 2 else ":",
                          hatch="////" if view.d == 2 and
                          np.mean(packing.radii) * view.points > 7 else None)),
        "rattler"))
  if contacts is not None and np.any(contacts.force > 0):
    parts = [TextArea(r"$f\,/\langle f\rangle$:", textprops=text)]
    for strength in (0.5, 1, 3, MAX_FORCE):
      colour = ForceColour(strength) if view.d == 2 else Mix("#D3DCE4", STRONG, 0.7)
      line = Line2D([0, 24], [height / 2] * 2, color=colour,
                    linewidth=strength * view.unit_width, solid_capstyle="butt")
      label = "%g" % strength
      if strength == MAX_FORCE and \
          contacts.force.max() > MAX_FORCE * np.mean(contacts.force):
        label = r"$\geq %g$" % strength
      parts.append(Entry(Sample(24, line), label))
    entries.append(HPacker(children=parts, align="center", pad=0, sep=9))
  if view.d == 3:
    steps = 12
    boxes = [Rectangle((4 * k, height / 2 - 5), 4.05, 10, linewidth=0,
                       facecolor=DepthColour(k / (steps - 1), 1))
             for k in range(steps)]
    entries.append(HPacker(
        children=[TextArea("back", textprops=text), Sample(4 * steps, *boxes),
                  TextArea("front", textprops=text)], align="center", pad=0, sep=5))
  figure.add_artist(AnchoredOffsetbox(
      "center", child=HPacker(children=entries, align="center", pad=0, sep=20),
      pad=0, frameon=False, bbox_to_anchor=(0.5, bottom / figure.get_size_inches()[1]),
      bbox_transform=figure.transFigure))


def PackingFigure(arguments):
  packing = ReadPacking(arguments.packing)
  contacts = ReadContacts(arguments.contacts, packing)
  width, side, foot = 6.6, 6.4, 0.5
  head = 0.42 + (0.34 if arguments.title else 0.0)
  spans = np.abs(packing.cell[:, :2]).sum(axis=0)
  side_height = min(1.3 * side, side * spans[1] / spans[0])
  total = side_height + head + foot
  figure = plt.figure(figsize=(width, total))
  view = View(figure, packing, 0.1, foot, side, side_height)
  Draw(view, contacts)
  words = Describe(packing, contacts)
  if view.d == 3:
    words.append("(projection)")
  figure.text(0.5, 1 - (head - 0.17) / total, "     ".join(words), ha="center",
              va="center", fontsize=12.5)
  if arguments.title:
    figure.text(0.5, 1 - 0.24 / total, arguments.title.replace("$", r"\$"),
                ha="center", va="center", fontsize=15, fontweight="bold")
  Key(figure, view, contacts, 0.26)
  return figure


def StagesFigure(arguments):
  name = lambda file: os.path.join(arguments.directory, file)
  packings = [ReadPacking(name(file)) for file in
              ("stage_initial.xyz", "stage_unjammed.xyz", "packing.xyz")]
  contacts = ReadContacts(name("contacts.csv"), packings[2])
  side, gap, head, foot = 4.1, 0.2, 0.72, 0.5
  spans = np.abs(packings[2].cell[:, :2]).sum(axis=0)
  height = min(1.3 * side, side * spans[1] / spans[0])
  total = (3 * side + 4 * gap, height + head + foot)
  figure = plt.figure(figsize=total)
  stages = ("initial", "last unjammed", "jammed")
  for k, (packing, stage) in enumerate(zip(packings, stages)):
    left = gap + k * (side + gap)
    view = View(figure, packing, left, foot, side, height)
    Draw(view, contacts if k == 2 else None)
    x = view.ax.get_position().x0 + 0.05 / total[0]
    words = Describe(packing, contacts if k == 2 else None)[1:]
    figure.text(x, 1 - 0.22 / total[1], "abc"[k], fontsize=17, fontweight="bold",
                va="center")
    figure.text(x + 0.26 / total[0], 1 - 0.22 / total[1],
                stage + (" (projection)" if view.d == 3 else ""), fontsize=15,
                va="center")
    figure.text(x, 1 - 0.54 / total[1], "   ".join(words), fontsize=12.5,
                va="center")
  Key(figure, view, contacts, 0.25, size=13.5)
  return figure


# ---------------------------------------------------------------- curves


def Decades(axis, low, high, zero=None):
  """Ticks at powers of ten, five at most, and `0` at `zero`."""
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
  axis.set_minor_locator(ticker.FixedLocator(minor))
  axis.set_minor_formatter(ticker.NullFormatter())


def Span(values):
  """Decades around positive values, with air."""
  if not len(values):
    return -1.0, 1.0
  low, high = math.log10(values.min()), math.log10(values.max())
  air = max(0.25, 0.06 * (high - low))
  return low - air, high + air


STAGES = (("growth", BLUE, "o", "growth"),
          ("bisection", ORANGE, "s", "bisection"),
          ("decompression", GREEN, "^", "decompression"))


def Scatter(ax, x, y, table, size=42):
  """Filled markers for jammed, open for unjammed, grey-filled for undecided."""
  stage, verdict = np.array(table["stage"]), np.array(table["verdict"])
  for name, colour, marker, _ in STAGES:
    for kind, fill in (("unjammed", "white"), ("undecided", PALE), ("jammed", colour)):
      chosen = (stage == name) & (verdict == kind) & np.isfinite(x) & np.isfinite(y)
      if chosen.any():
        ax.scatter(x[chosen], y[chosen], s=size, marker=marker, facecolor=fill,
                   edgecolor=Mix(colour, INK, 0.25), linewidth=1.0, zorder=4,
                   clip_on=False)


def Guide(ax, x, y, slope, label):
  """A line of that slope above the points, over the upper decades."""
  high = math.log10(x.max())
  low = max(math.log10(x.min()), high - 3)
  if high - low < 0.5:
    return
  near = np.abs(np.log10(x) - (high + low) / 2).argmin()
  ends = np.array([low, high])
  line = math.log10(y[near]) + slope * (ends - math.log10(x[near]))
  down = -0.06 * np.ptp(np.log10(ax.get_ylim()))
  ax.plot(10**ends, 10**(line + down), color=GREY, linewidth=1.2, linestyle=(0, (5, 3)),
          zorder=2)
  middle = ends.mean() + 0.1 * np.ptp(ends)
  ax.annotate(label, (10**middle, 10**(line.mean() + slope * 0.1 * np.ptp(ends) + down)),
              xytext=(8, -10), textcoords="offset points", ha="left", va="top",
              color=GREY)


def PathFigure(arguments):
  names = ("stage", "phi", "energy", "pressure", "coordination", "rigid_grains",
           "verdict")
  table = ReadTable(arguments.table, names, words=("stage", "verdict"))
  if not len(table["phi"]):
    raise InputError("%s: no rows" % arguments.table)
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
    beyond = jammed & (phi > phi_j)
    excess[beyond] = phi[beyond] - phi_j
  zoom = np.isfinite(excess).any()

  figure, axes = plt.subplots(
      3, 2 if zoom else 1, squeeze=False, sharex="col",
      figsize=(11.0 if zoom else 6.6, 8.4),
      gridspec_kw=dict(left=0.09 if zoom else 0.15, right=0.93 if zoom else 0.96,
                       top=0.905, bottom=0.08, wspace=0.05, hspace=0.08))
  for row, (name, label) in enumerate((("energy", "energy  $E$"),
                                       ("pressure", "pressure  $p$"))):
    values = table[name]
    positive = np.isfinite(values) & (values > 0)
    low, high = Span(values[positive])
    strip = 0.17 * (high - low)  # for zeros
    zero = 10**(low - strip / 2)
    shown = np.where(positive, values, np.where(values == 0, zero, np.nan))
    for column, x in enumerate((phi, excess)[:2 if zoom else 1]):
      ax = axes[row, column]
      ax.set_yscale("log")
      bottom = low - strip if (values == 0).any() else low
      ax.set_ylim(10**bottom, 10**high)
      Decades(ax.yaxis, low, high, zero if (values == 0).any() else None)
      if (values == 0).any():
        ax.axhspan(10**bottom, 10**low, facecolor="#F1F3F5", linewidth=0, zorder=0)
        ax.axhline(10**low, color=GREY, linewidth=0.7, zorder=1)
      Scatter(ax, x, shown, table)
    axes[row, 0].set_ylabel(label)
  z = table["coordination"]
  axes[2, 0].set_ylabel("coordination  $z$")
  axes[2, 0].set_ylim(-0.35, max(1.0, np.nanmax(z)) * 1.12)
  axes[2, 0].yaxis.set_major_locator(ticker.MaxNLocator(5, integer=True))
  Scatter(axes[2, 0], phi, z, table)
  axes[2, 0].set_xlabel(r"packing fraction  $\phi$")
  axes[2, 0].xaxis.set_major_locator(ticker.MaxNLocator(5))
  axes[2, 0].margins(x=0.06)
  if phi_j is not None:
    for row in range(3):
      axes[row, 0].axvline(phi_j, color=GREY, linewidth=1.0, linestyle=(0, (5, 3)),
                           zorder=1)
    axes[2, 0].annotate(r"$\phi_J = %.6f$" % phi_j, (phi_j, 0.5),
                        xycoords=("data", "axes fraction"), xytext=(-8, 0),
                        textcoords="offset points", ha="right", va="center", color=INK)

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
        Guide(ax, excess[good], table[name][good], slope, "slope %g" % slope)
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
      values = np.append(z[chosen], isostatic)
      air = max(0.02, 0.12 * np.ptp(values))
      ax.set_ylim(values.min() - 1.6 * air, values.max() + air)
      ax.annotate(r"isostatic  $%d - %d/N' = %.4f$" % (2 * d, 2 * (d - 1), isostatic),
                  (0.97, isostatic), xycoords=("axes fraction", "data"),
                  xytext=(0, -6), textcoords="offset points", ha="right", va="top",
                  color=GREY)
    ax.yaxis.set_major_locator(ticker.MaxNLocator(5))

  handles = [Line2D([], [], linestyle="", marker=marker, markersize=8,
                    markerfacecolor=colour, markeredgecolor=Mix(colour, INK, 0.25),
                    label=label)
             for name, colour, marker, label in STAGES if name in table["stage"]]
  for verdict, fill in (("unjammed", "white"), ("undecided", PALE)):
    if verdict in table["verdict"]:
      handles.append(Line2D([], [], linestyle="", marker="o", markersize=8,
                            markerfacecolor=fill, markeredgecolor=INK, label=verdict))
  figure.legend(handles=handles, loc="upper center", ncol=len(handles),
                bbox_to_anchor=(0.51, 0.985), fontsize=13, handletextpad=0.2,
                columnspacing=1.4)
  for ax in axes.flat:
    ax.tick_params(which="both", top=True, right=True)
  figure.align_ylabels(axes[:, 0])
  return figure


def TraceFigure(arguments):
  table = ReadTable(arguments.table, ("iteration", "energy", "max_gradient",
                                      "mean_force", "vanishing", "seconds"))
  scale = table["mean_force"]
  residual = np.full(len(scale), np.nan)
  np.divide(table["max_gradient"], scale, out=residual, where=scale > 0)
  residual[~(residual > 0)] = np.nan
  if not np.isfinite(residual).any():
    raise InputError("%s: no row with a positive max_gradient and mean_force" %
                     arguments.table)
  figure, axes = plt.subplots(
      1, 2, sharey=True, figsize=(10.4, 4.4),
      gridspec_kw=dict(left=0.095, right=0.975, top=0.95, bottom=0.16, wspace=0.06))
  low, high = Span(residual[np.isfinite(residual)])
  few = np.isfinite(residual).sum() <= 40
  for ax, name, label in zip(axes, ("iteration", "seconds"), ("iterations", "seconds")):
    ax.set_yscale("log")
    ax.plot(table[name], residual, color=BLUE, marker="o" if few else None,
            markersize=4.5)
    last = np.nonzero(np.isfinite(residual))[0][-1]
    ax.plot(table[name][last], residual[last], "o", color=BLUE, markersize=7,
            clip_on=False, zorder=4)
    ax.set_xlabel(label)
    ax.margins(x=0.03)
    ax.xaxis.set_major_locator(ticker.MaxNLocator(6))
    ax.grid(True, which="major", color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)
  axes[0].set_ylim(10**low, 10**high)
  Decades(axes[0].yaxis, low, high)
  axes[0].set_ylabel(r"$\max|g|\,/\,\langle f\rangle$")
  return figure


# ---------------------------------------------------------------- output


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
      figure.savefig(temporary, format=kind, dpi=DPI, metadata=metadata)
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
