"""Jamming paths, ensembles of jamming points, distributions of forces and gaps."""

import math

import numpy as np
from matplotlib import ticker
from matplotlib.lines import Line2D

from figures.commands import Figure
from figures.style import (BLUE, Decades, Frame, GREEN, GREY, Help, INK, LogAxis, Mix,
                           ORANGE, PALE, PURPLE, Panels, RowOfPanels, SizeColours, Span,
                           VERMILION, WithError)
from figures.tables import InputError, ReadTable

STAGES = (("start", PURPLE, "D"), ("growth", BLUE, "o"), ("bisection", ORANGE, "s"),
          ("decompression", GREEN, "^"))


def Scatter(ax, x, y, table, size=42):
  """Filled markers for jammed, open for unjammed, grey-filled for undecided."""
  stage, verdict = table["stage"], table["verdict"]
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


@Figure("path", phi_j=float, dimension=(2, 3))
def PathFigure(path_csv, phi_j=None, alpha=2.0, dimension=2):
  """Of `jamming`: energy, pressure and coordination along a jamming path."""
  names = ("stage", "phi", "energy", "pressure", "coordination", "rigid_grains",
           "verdict")
  table = ReadTable(path_csv, names, words=("stage", "verdict"))
  if not len(table["phi"]) or not np.isfinite(table["phi"]).all():
    raise InputError("%s: no rows, or a phi that is not finite" % path_csv)
  for name, known in (("stage", [s[0] for s in STAGES]),
                      ("verdict", ["jammed", "unjammed", "undecided"])):
    for line, word in enumerate(table[name], 2):
      if word not in known:
        raise InputError("%s:%d: %s %r is none of %s" %
                         (path_csv, line, name, word, ", ".join(known)))
  phi, phi_j, d = table["phi"], phi_j, dimension
  jammed = table["verdict"] == "jammed"
  excess = np.full(len(phi), np.nan)
  if phi_j is not None:
    # phi_J is that of the decompressed branch, if there is one.
    beyond = jammed & (phi > phi_j)
    branch = beyond & (table["stage"] == "decompression")
    beyond = branch if branch.sum() > 1 else beyond
    excess[beyond] = phi[beyond] - phi_j
  zoom = np.isfinite(excess).any()

  figure, axes = Panels(3, 2 if zoom else 1, 11.0 if zoom else 6.6, 8.4, left=1.0,
                        right=0.77 if zoom else 0.26, top=0.63 if zoom else 0.76,
                        sharex="col", wspace=0.05, hspace=0.08)
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
    for row, name, slope in ((0, "energy", alpha),
                             (1, "pressure", alpha - 1)):
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


# phi_J for N -> infinity and a rapid quench, bidisperse 1:1.4: O'Hern, Silbert, Liu,
# Nagel, Phys. Rev. E 68 (2003) 011306.
LITERATURE_PHI = {2: 0.8418, 3: 0.648}


@Figure("ensemble", dimension=(2, 3))
def EnsembleFigure(ensemble_csv, dimension=2):
  """Of `jamming --seeds`: histograms of phi_J, a row a number of grains."""
  table = ReadTable(ensemble_csv, ("particles", "seed", "phi_j", "error"))
  sizes = sorted(set(table["particles"].astype(int)))
  colours = SizeColours(sizes)
  literature = LITERATURE_PHI[dimension]
  low, high = table["phi_j"].min(), table["phi_j"].max()
  if low - 0.6 * (high - low) < literature < high + 0.6 * (high - low):
    low, high = min(low, literature), max(high, literature)
  air = 0.06 * (high - low) or 1e-3
  low, high = low - air, high + air
  row = 1.35 if len(sizes) > 1 else 2.6
  width, height = 8.2, 1.13 + row * len(sizes)
  figure, axes = Panels(len(sizes), 1, width, height, right=1.75, top=0.3, sharex=True,
                        hspace=0.16)
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
  axes[-1, 0].set_xlabel(r"packing fraction at jamming  $\phi_J$")
  axes[-1, 0].xaxis.set_major_locator(ticker.MaxNLocator(6))
  Help(figure, "Each tick is the jamming point of one packing; circle, thick and thin "
       "bar: their mean, its standard error, and their standard deviation. "
       "Dashed: %g, the literature\u2019s value for a rapid quench and N \u2192 "
       "\u221e; small packings jam below it." % literature)
  middle = (axes[0, 0].get_position().y1 + axes[-1, 0].get_position().y0) / 2
  figure.text(0.28 / figure.get_figwidth(), middle, "packings", rotation=90, ha="center",
              va="center", fontsize=14)
  return figure


@Figure("finite_size", dimension=(2, 3))
def FiniteSizeFigure(sizes_csv, dimension=2, fit=""):
  """Of `jamming --seeds`: mean phi_J against the number of grains, and PHI - C
  N^-EXPONENT if --fit=PHI,ERROR,C,ERROR,EXPONENT is given."""
  table = ReadTable(sizes_csv, ("particles", "complete", "phi_j", "standard_deviation",
                                "standard_error", "least", "most"))
  if fit:
    try:
      phi, error, c, c_error, exponent = numbers = [float(w) for w in fit.split(",")]
      if not np.isfinite(numbers).all():
        raise ValueError
    except ValueError:
      raise InputError("--fit=%s: five numbers expected" % fit)
  figure, (ax,) = RowOfPanels(1, 7.6, 5.38, left=1.2, right=0.2, top=0.2)
  n, mean = table["particles"], table["phi_j"]
  first, last = n.min() / 1.45, n.max() * 1.9
  ax.set_xscale("log")
  ax.set_xlim(first, last)
  literature = LITERATURE_PHI[dimension]
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
  Frame(ax)
  counts = sorted(set(table["complete"].astype(int)))
  Help(figure, "Points: means over %s packings with their standard errors; wide bars: "
       "standard deviation, thin ones: least to largest. %s" %
       ("%d" % counts[0] if len(counts) == 1 else "%d to %d" % (counts[0], counts[-1]),
        "Red: the fit, whose exponent is the literature\u2019s, and (band) where it "
        "ends for N \u2192 \u221e; dashed: where the literature says a rapid quench "
        "does." if fit else
        "Dashed: the literature\u2019s value for a rapid quench and N \u2192 \u221e."))
  return figure


# Of DISTRIBUTIONS.csv: what a panel shows.
QUANTITIES = (
    ("theta_localized", "weak forces of bucklers", r"$f\,/\,\langle f\rangle$",
     r"\theta_\ell", 1),
    ("theta_extended", "weak forces of all others", r"$f\,/\,\langle f\rangle$",
     r"\theta_e", 1),
    ("gamma", "small gaps", r"gap  $h\,/\,(r_i + r_j)$", r"\gamma", -1))


@Figure("distributions")
def DistributionsFigure(forces_csv, gaps_csv, distributions_csv):
  """Of `jamming`: cumulative distributions of weak forces and small gaps. Cumulative,
  so that nothing is binned; the fit is drawn on its window."""
  forces = ReadTable(forces_csv, ("particles", "kind", "force"), words=("kind",),
                     may_be_empty=True)
  gaps = ReadTable(gaps_csv, ("particles", "gap"), may_be_empty=True)
  fits = ReadTable(distributions_csv, ("particles", "quantity", "samples", "blur",
                                       "low", "high", "exponent", "error",
                                       "literature"), words=("quantity",),
                   may_be_empty=True)
  sizes = sorted(set(forces["particles"].astype(int)) | set(gaps["particles"].astype(int)))
  if not sizes:
    raise InputError("%s: no rows" % forces_csv)
  colours = SizeColours(sizes)
  kind = forces["kind"]
  quantity = fits["quantity"]
  theory = dict(theta_localized=0.17462, theta_extended=0.42311, gamma=0.41269)
  panels = {
      "theta_localized": (forces["particles"][kind == "localized"],
                          forces["force"][kind == "localized"]),
      "theta_extended": (forces["particles"][kind == "extended"],
                         forces["force"][kind == "extended"]),
      "gamma": (gaps["particles"], gaps["gap"])}
  figure, axes = RowOfPanels(3, 14.4, 5.48, right=0.3, top=0.45, wspace=0.2)
  for ax, (name, title, label, symbol, sign) in zip(axes, QUANTITIES):
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
    LogAxis(ax.xaxis, x_low, x_high)
    LogAxis(ax.yaxis, low, high)
    if drawn is not None:
      k = mine[drawn]
      s, least, end = 1 + sign * fits["exponent"][k], fits["low"][k], fits["high"][k]
      x = values[(of == drawn) & (values >= fits["blur"][k])]
      below, upto = np.mean(x < least), np.mean(x <= end)
      t = np.geomspace(max(least, x.min()), end, 200)
      if abs(s) > 1e-6:
        rise = (t**s - least**s) / (end**s - least**s)
        # From half a contact on: an empty beginning has no logarithm.
        ax.plot(t, np.maximum(below, 0.5 / len(x)) * (1 - rise) + upto * rise, color=INK,
                linewidth=2.0,
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
  Frame(*axes)
  axes[0].set_ylabel("part of all that are smaller")
  Help(figure, "Cumulative distributions of contact forces over their mean and of gaps "
       "between grains that nearly touch; dashed: the power law of most likelihood, "
       "on the part that it fits best, the exponent with its error in units of the "
       "last digit. Grey: the slope that mean-field theory predicts; the steps at the far "
       "left are single contacts and say little.")
  return figure
