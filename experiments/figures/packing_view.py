"""How a packing is drawn: discs with force chains in 2D, a projection in 3D."""

import itertools
import math

import numpy as np
from matplotlib.collections import EllipseCollection, LineCollection, PathCollection
from matplotlib.lines import Line2D
from matplotlib.offsetbox import AnchoredOffsetbox, DrawingArea, HPacker, TextArea, VPacker
from matplotlib.patches import Circle, PathPatch, Polygon, Rectangle
from matplotlib.path import Path

from figures.packing_files import MarkedRattlers, MeanForce
from figures.style import BLUE, FOG, GREY, INK, Mix, PURPLE

SPECIES_FILLS = ("#BCD6EA", "#F6E7C4", "#CFE6D8", "#E9D3E2")
SPECIES_NODES = ("#4C9BD0", "#F2B93B", "#2FA57F", PURPLE)  # in projections
WEAK, MEAN, STRONG = "#E0906E", "#B5301F", "#5A0713"  # force chains
MAX_FORCE = 6.0  # of the mean; stronger contacts are drawn as this one
MIN_FORCE = 0.03  # drawn as hairlines below
HATCH_ABOVE = 4.5  # points of mean radius; smaller rattlers are white
RASTER_ABOVE = 20000  # grains; discs and chains are then a picture in the SVG


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
    rows.append(Row("projection along z, spheres reduced:   back",
                    Sample(3 * steps, *shades), "front"))
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
