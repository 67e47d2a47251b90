"""The one look of all figures: colours, axes, legends, captions, files."""

import io
import math
import os
import re
import textwrap

import numpy as np
import matplotlib
from matplotlib import pyplot as plt
from matplotlib import ticker
from matplotlib.collections import EllipseCollection
from matplotlib.lines import Line2D

from figures.tables import InputError


# Colours of Okabe and Ito, which the colour-blind tell apart, and pale fills of
# different lightness.
BLUE, ORANGE, GREEN, VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
PURPLE, SKY = "#CC79A7", "#56B4E9"
INK, GREY, PALE = "#22262B", "#6B737C", "#D9DDE1"
FOG = "#E4E9EE"
DPI = 180
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


def Mix(first, second, t):
  a = np.array(matplotlib.colors.to_rgb(first))
  b = np.array(matplotlib.colors.to_rgb(second))
  return matplotlib.colors.to_hex((1 - t) * a + t * b)


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


def LogAxis(axis, low, high, end=None):
  """Logarithmic, from 10^low to 10^high, or without ticks further to 10^end."""
  ax, ends = axis.axes, (10**low, 10**(high if end is None else end))
  if axis is ax.xaxis:
    ax.set_xscale("log")
    ax.set_xlim(*ends)
  else:
    ax.set_yscale("log")
    ax.set_ylim(*ends)
  Decades(axis, low, high)


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


METHOD_COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, INK, SKY, GREY)
METHOD_DASHES = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
METHOD_MARKERS = "os^Dv<>p"


def MethodStyles(names):
  """Colour, dashes and marker of each method, in the order of the table."""
  return {name: (METHOD_COLOURS[k % 8], METHOD_DASHES[k % 4 if len(names) <= 8 else
                                                      (k + k // 8) % 4],
                 METHOD_MARKERS[k % 8])
          for k, name in enumerate(names)}


def Panels(rows, columns, width, height, left=0.85, right=0.25, top=0.4, bottom=0.68,
           sharex=False, sharey=False, **grid):
  """Axes (rows x columns) in a figure of so many inches with these margins."""
  return plt.subplots(
      rows, columns, squeeze=False, figsize=(width, height), sharex=sharex,
      sharey=sharey, gridspec_kw=dict(left=left / width, right=1 - right / width,
                                      top=1 - top / height, bottom=bottom / height,
                                      **grid))


def RowOfPanels(columns, width, height, **properties):
  """One row of them."""
  figure, axes = Panels(1, columns, width, height, **properties)
  return figure, axes[0]


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


def Frame(*axes):
  """A grid, and ticks on all four sides."""
  for ax in axes:
    ax.grid(True, which="major", color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True)


def Help(figure, text, right=0.0):
  """How to read the figure, below everything, in small type, `right` inches short of the
  edge; the axes stay as large as they are. The height in inches that it takes."""
  width = figure.get_figwidth()
  lines = textwrap.wrap(text, int(13.6 * (width - right) - 3))
  below = 0.165 * len(lines) + 0.1
  Extend(figure, below=below)
  text = "\n".join(lines)
  for word, symbol in (("\u03c6_cr", r"$\phi_{\mathrm{cr}}$"), ("\u03c6_J", r"$\phi_J$")):
    text = text.replace(word, symbol)
  figure.text(0.14 / width, 0.1 / figure.get_figheight(), text, ha="left", va="bottom",
              fontsize=9.5, linespacing=1.25, color=GREY)
  return below


def Shortened(name, most=24):
  """A label that must stand beside an axis."""
  name = name.replace("$", r"\$")
  return name if len(name) <= most else name[:most - 1] + "\u2026"


def SizeColours(sizes):
  """The largest number of grains in blue, smaller ones in other colours."""
  order = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, INK, GREY)
  sizes = sorted(set(int(size) for size in sizes))
  return {size: order[k % len(order)] for k, size in enumerate(reversed(sizes))}


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


def Shade(colour):
  return Mix(colour, "#FFFFFF", 0.45)


FLOOR = 1e-15  # errors below are drawn there


def Band(ax, x, mean, deviation, colour, label, dashes="-"):
  ax.fill_between(x, mean - deviation, mean + deviation, color=colour, alpha=0.22,
                  linewidth=0)
  ax.plot(x, mean, color=colour, linewidth=1.9, label=label, linestyle=dashes)


def TimesTen(values):
  """A power of ten to divide by, and how it is written on an axis."""
  most = np.nanmax(np.abs(values)) if len(values) else 0.0
  exponent = math.floor(math.log10(most)) if most > 0 else 0
  if abs(exponent) <= 1:
    return 1.0, ""
  return 10.0**exponent, r" / $10^{%d}$" % exponent


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
