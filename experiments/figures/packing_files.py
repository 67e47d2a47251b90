"""Packings and contacts as the experiments write them, and numbers of them."""

import math
import re
from collections import namedtuple

import numpy as np

from figures.style import Scientific
from figures.tables import InputError, ReadTable, ReadText

Packing = namedtuple("Packing", "cell positions radii species")
# cell: d x d, rows are edges; positions: N x d; species: N indices; names in order.
Contacts = namedtuple("Contacts", "i j force distance normal rigid")


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


def ReadContacts(path, packing):
  count, d = packing.positions.shape
  table = ReadTable(path, ("i", "j", "force", "distance", "nx", "ny", "nz", "rigid"),
                    may_be_empty=True)
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
