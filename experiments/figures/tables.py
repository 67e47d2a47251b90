"""CSV files, and errors of what is given."""

import csv

import numpy as np


class InputError(Exception):
  """One line that says what is wrong, and where."""


def ReadText(path):
  try:
    with open(path, encoding="utf-8") as file:
      return file.read()
  except (OSError, UnicodeDecodeError) as error:
    raise InputError("%s: %s" % (path, getattr(error, "strerror", None) or error))


def ReadTable(path, required, words=(), may_be_empty=False):
  """Columns by name: arrays of numbers, of strings for those in `words`."""
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
  if not may_be_empty and not table[required[0]]:
    raise InputError("%s: no rows" % path)
  return {name: np.array(column, str if name in words else float)
          for name, column in table.items()}


def Chosen(table, rows):
  return {name: column[rows] for name, column in table.items()}


def Unique(values):
  """In the order of their first appearance."""
  return list(dict.fromkeys(values))


def Parameters(path, known):
  """Names of columns that are parameters: those between the known first and the first of
  the known others."""
  line = ReadText(path).splitlines()[:1]
  names = [name.strip() for name in line[0].split(",")] if line else []
  return [name for name in names if name not in known]
