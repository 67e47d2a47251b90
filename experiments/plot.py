"""The figures of the experiments, from the files that they write.

Each writes OUT.svg and OUT.png, both or neither. The same input gives the same
bytes. Bad input or usage: one line on stderr, status 2. A new figure is a function in a
file of figures/ (see figures/commands.py); nothing else is edited.
"""

import importlib
import pkgutil
import sys

try:
  import matplotlib
  matplotlib.use("Agg")
except ImportError as error:
  sys.stderr.write("plot.py: %s (apt install python3-matplotlib)\n" % error)
  sys.exit(2)

import figures
from figures import commands, style, tables


def main():
  for module in pkgutil.iter_modules(figures.__path__):
    importlib.import_module("figures." + module.name)
  try:
    figure, arguments, out = commands.Parse(sys.argv[1:], __doc__)
    matplotlib.rcdefaults()  # no personal style
    matplotlib.rcParams.update(style.STYLE)
    style.Save(figure(**arguments), out)
  except tables.InputError as error:
    sys.stderr.write("plot.py: %s\n" % error)
    return 2
  return 0


if __name__ == "__main__":
  sys.exit(main())
