"""Figures by name. A figure is a function: its positional parameters are files, its
keyword parameters are options, its docstring says what it shows."""

import argparse
import inspect

from figures.tables import InputError

FIGURES = {}


def Figure(name, **kinds):
  """Makes the function below the figure `name` of plot.py. A parameter without a
  default is a file or a folder, one with a default an option, which may be given several
  times if the default is (). `kinds` of parameters are types or tuples of choices; the
  type of the default if left out."""
  def Register(function):
    FIGURES[name] = function, kinds
    return function
  return Register


class _Parser(argparse.ArgumentParser):

  def error(self, message):
    raise InputError(message)


def _Options(parameter, kind):
  """What argparse wants to know of a parameter."""
  default = parameter.default
  if kind is None:
    kind = str if default in (parameter.empty, ()) else type(default)
  options = (dict(choices=kind, type=type(kind[0])) if isinstance(kind, tuple)
             else dict(type=kind))
  if default is parameter.empty:
    stem, _, ending = parameter.name.rpartition("_")
    options["metavar"] = (stem.upper() + "." + ending if ending in ("csv", "xyz")
                          else parameter.name.upper())
  elif default == ():
    options.update(action="append", default=[])
  else:
    options["default"] = default
  return options


def Parse(words, description):
  """(figure, its arguments by name, OUT) of a command line."""
  parser = _Parser(prog="plot.py", description=description,
                   formatter_class=argparse.RawDescriptionHelpFormatter)
  commands = parser.add_subparsers(dest="figure", required=True, metavar="FIGURE")
  for name, (function, kinds) in FIGURES.items():
    summary = " ".join(function.__doc__.split()).replace("%", "%%")
    command = commands.add_parser(name, help=summary.partition(". ")[0].rstrip("."),
                                  description=summary)
    for parameter in inspect.signature(function).parameters.values():
      is_file = parameter.default is parameter.empty
      command.add_argument(("" if is_file else "--") + parameter.name,
                           **_Options(parameter, kinds.get(parameter.name)))
    command.add_argument("out", metavar="OUT")
  values = vars(parser.parse_args(words))
  return FIGURES[values.pop("figure")][0], values, values.pop("out")
