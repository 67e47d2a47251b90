"""Scaling laws near jamming, spectra, and what a grain costs."""

import math

import numpy as np
from matplotlib.lines import Line2D

from figures.commands import Figure
from figures.style import (BLUE, Frame, GREEN, GREY, Help, INK, LogAxis, ORANGE, PURPLE,
                           Panels, Power, RowOfPanels, Shade, SizeColours, Span,
                           VERMILION)
from figures.tables import InputError, ReadTable, Unique


@Figure("grain_cost")
def GrainCostFigure(grain_cost_csv):
  """What a grain costs against the number of grains (experiments/grain_cost.sh)."""
  table = ReadTable(grain_cost_csv, ("particles", "method", "threads", "evaluations",
                                     "seconds", "energy_seconds", "peak_bytes"),
                    words=("method",))
  methods = Unique(table["method"])
  figure, axes = RowOfPanels(2, 12.6, 4.88, left=0.95, right=0.3, top=0.45,
                             wspace=0.22)
  method = table["method"]
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
    Frame(ax)
  Help(figure, "First-order methods on discs that still rearrange, with the lists of "
       "neighbours that this needs. Small packings live in caches, large ones wait "
       "for memory. Right: all that the process takes, libraries included; dashed: "
       "a kilobyte a grain.")
  return figure


LAWS = (("pressure", "pressure  $p$", "Fig. 4"), ("shear", "shear modulus  $G$ (13)", "Fig. 5"),
        ("excess", r"excess contacts  $z - z_{\rm iso}$", "Fig. 6"),
        ("bulk", r"bulk modulus  $B$ (12)", ""))
ALPHA_COLOURS = (BLUE, VERMILION, GREEN, PURPLE)


def Claimed(name, alpha):
  """The exponent that the paper finds; for B the theory's."""
  return {"pressure": alpha - 1, "shear": alpha - 1.5, "excess": 0.5,
          "bulk": alpha - 2}[name]


@Figure("laws")
def LawsFigure(states_csv, exponents=""):
  """Of `scaling`: pressure, moduli, coordination against the distance to jamming."""
  table = ReadTable(states_csv, ("particles", "alpha", "asked",
                                 "distance") + tuple(law[0] for law in LAWS))
  fits = {}
  if exponents:
    rows = ReadTable(exponents, ("quantity", "alpha", "particles", "exponent", "low",
                                 "high", "prefactor", "from", "to", "distances"),
                     words=("quantity",), may_be_empty=True)
    for k, name in enumerate(rows["quantity"]):
      fits[name, rows["alpha"][k], rows["particles"][k]] = {
          key: rows[key][k] for key in rows if key != "quantity"}
  size = table["particles"].max()
  of_size = table["particles"] == size
  alphas = sorted(set(table["alpha"][of_size]))
  colours = {alpha: ALPHA_COLOURS[k % 4] for k, alpha in enumerate(alphas)}
  figure, axes = Panels(2, 2, 12.2, 8.53, left=0.95, top=0.5, sharex=True,
                        wspace=0.2, hspace=0.1)
  packings, negative = 0, False
  for ax, (name, label, paper) in zip(axes.flat, LAWS):
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
    LogAxis(ax.yaxis, low, high, high + 0.16 * (high - low))
    ax.set_ylabel(label)
    for k, (text, colour) in enumerate(lines):
      ax.text(0.03, 0.965 - 0.062 * k, text, transform=ax.transAxes, va="top",
              color=colour, fontsize=12)
    if paper:
      ax.text(0.975, 0.035, paper, transform=ax.transAxes, ha="right", color=GREY)
    Frame(ax)
  low, high = Span(table["distance"][of_size])
  for ax in axes[1]:
    LogAxis(ax.xaxis, low, high)
    ax.set_xlabel(r"$\phi - \phi_J$")
  axes[0, 0].set_title("$N = %d$, %d packing%s for each exponent of the contact energy" %
                       (size, packings, "" if packings == 1 else "s"), loc="left", pad=9)
  Help(figure, "Small dots: packings; circles: their medians; lines: fits through "
       "the medians, exponent with its 95 % interval over packings; dashed: the exponent "
       "claimed, through the upper half of the medians."
       + (" Open triangles: negative shear moduli, as |G|; medians count them as negative."
          if negative else ""))
  return figure


@Figure("collapse")
def CollapseFigure(states_csv):
  """Of `scaling`: shear modulus and excess contacts of all sizes against P N^2."""
  table = ReadTable(states_csv, ("particles", "alpha", "asked", "reduced", "excess",
                                 "shear", "stiffness", "rigid_grains"))
  sizes, alphas = sorted(set(table["particles"])), sorted(set(table["alpha"]))
  colours = SizeColours(sizes)
  markers = dict(zip(alphas, "os^D"))
  figure, axes = RowOfPanels(2, 12.2, 4.93, left=0.95, top=0.3, wspace=0.2)
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
          ax.errorbar(xs, ys, yerr=(np.minimum(ys - low, 0.9 * ys), high - ys),
                      color=colours[size], linewidth=1.2,
                      linestyle="", marker=markers[alpha], markersize=7, capsize=2,
                      markeredgecolor="white", zorder=4)
        if lost:
          ax.plot(*zip(*lost), "v", color="white", markersize=7,
                  markeredgecolor=colours[size], zorder=3)
    if drawn:
      low, high = Span(np.array(drawn))
      LogAxis(ax.yaxis, low, high)
    ax.set_ylabel(label)
    ax.set_xlabel("$P\\,N^2$")
    Frame(ax)
  if everything:
    low, high = Span(np.array(everything))
    for ax in axes:
      LogAxis(ax.xaxis, low, high)
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
  Help(figure, "Medians and quartiles over packings, P = (p / (k r^(\u03b1\u2212d)))"
       "^(1/(\u03b1\u22121)), \u03ba the mean stiffness of contacts. That all sizes lie on one "
       "curve is finite-size scaling (Goodrich, Liu, Nagel 2012); where P N\u00b2 falls below "
       "10 a packing has hardly a contact more than it must. Open triangles: medians of "
       "G that are negative, as |G|.")
  return figure


@Figure("vibrations")
def VibrationsFigure(spectrum_csv):
  """Of `scaling`: density of states and participation ratios."""
  table = ReadTable(spectrum_csv, ("particles", "seed", "alpha", "asked", "complete",
                                   "frequency", "participation"))
  chosen = (table["complete"] == 1) & (table["frequency"] > 0)
  if not chosen.any():
    raise InputError("%s: no complete spectrum" % spectrum_csv)
  size = table["particles"][chosen].max()
  alpha = table["alpha"][chosen].min()
  chosen &= (table["particles"] == size) & (table["alpha"] == alpha)
  levels = sorted(set(table["asked"][chosen]))
  order = (BLUE, GREEN, ORANGE, VERMILION, PURPLE, INK)
  figure, axes = RowOfPanels(2, 12.2, 5.13, left=0.95, top=0.3, sharex=True,
                             wspace=0.2)
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
    LogAxis(ax.xaxis, low - 0.1, high + 0.1)
    ax.set_xlabel(r"frequency  $\omega\,/\,\sqrt{\kappa/m}$")
    Frame(ax)
  axes[0].set_yscale("log")
  axes[0].set_ylabel(r"density of states  $D(\omega)$")
  axes[0].legend(loc="lower right", fontsize=12)
  axes[1].set_ylabel("participation ratio")
  axes[1].set_ylim(0, 1)
  unstable = int(((table["frequency"] < 0) & (table["particles"] == size)).sum())
  Help(figure, "All modes of %d packing%s, N = %d, \u03b1 = %g, masses 1, \u03ba the mean stiffness "
       "of contacts. Nearer to jamming the plateau reaches to lower frequencies. Right: "
       "1 if all grains take part alike, 1/N' for a single one; lines: means.%s" %
       (packings, "" if packings == 1 else "s", size, alpha,
        " %d unstable modes are not shown." % unstable if unstable else ""))
  return figure
