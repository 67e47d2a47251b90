"""Performance profiles, quality of results, whole protocols."""

import math
import os

import numpy as np
from matplotlib import ticker
from matplotlib.lines import Line2D

from figures.commands import Figure
from figures.comparison import ComparisonAxes
from figures.style import (Decades, Frame, GREY, Help, INK, LogAxis, MethodLegend,
                           MethodStyles, PALE, Panels, RowOfPanels, Shortened, Span)
from figures.tables import InputError, ReadTable, Unique


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
  solver = table["solver"]
  result = {}
  for method in Unique(solver[chosen]):
    mine = chosen & (solver == method) & np.isfinite(table[column])
    order = np.argsort(table[column][mine], kind="stable")
    result[method] = table[column][mine][order], table["fraction"][mine][order]
  return result


PROFILE_HELP = (
    "At a factor \u03c4 a curve shows on which part of the problems a method got there "
    "with at most \u03c4 times the work of the method that was cheapest on that problem: "
    "at \u03c4 = 1 how often it was the cheapest itself, at the right end how often it got "
    "there at all. "
    "Higher is better, but only beside the best method, since the order of two others may "
    "change when a third is left out; an evaluation may come with a factorization, which "
    "only CPU time knows.")


@Figure("profile")
def ProfileFigure(profile_csv):
  """Of `compare`: the part of the problems within a factor of the cheapest method."""
  table = ReadTable(profile_csv, ("problems", "measure", "solver", "count", "ratio",
                                  "fraction"), words=("problems", "measure", "solver"))
  styles = MethodStyles(Unique(table["solver"]))
  problems, measures = table["problems"], table["measure"]
  rows = Unique(table["problems"])
  figure, axes = ComparisonAxes(len(rows))
  for row, name in enumerate(rows):
    for column, (measure, label) in enumerate((("evaluations", "evaluations"),
                                               ("cpu_seconds", "CPU time"))):
      ax = axes[row, column]
      chosen = (problems == name) & (measures == measure)
      if not chosen.any():
        raise InputError("%s: no rows of %s, %s" % (profile_csv, name, measure))
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
  Frame(*axes.flat)
  MethodLegend(figure, styles)
  Help(figure, PROFILE_HELP)
  return figure


QUALITY_LABELS = {
    "energy": r"$(E - E_{\mathrm{best}})\,/\,E$",
    "path": r"$|E - E_{\mathrm{ref}}|\,/\,E$",
    "excess": r"$(\phi_{\mathrm{cr}} - \phi_J)\,/\,\epsilon$",
}
ROUNDING = 1e-12  # relative differences below are rounding


QUALITY_HELP = {
    "energy": (
        "Left, a curve shows which part of the problems a method ended within that much of "
        "the least energy that any method found, so a curve that stays low on the left has "
        "ended in higher minima or was not done. "
        "Right, how often it ended in the very minimum of the reference, with Wilson's 95 % "
        "interval: costs of methods that end in different minima are not those of one task."),
    "path": (
        "Left, a curve shows at which part of the strains a method's energy is the "
        "reference's to within that much of it; what lies far to the right was sheared "
        "through other rearrangements. "
        "Right, in how many whole runs it stayed with the reference all the way, with "
        "Wilson's 95 % interval, which takes runs as independent: those of one seed at "
        "several tolerances are not."),
    "excess": (
        "Left, a curve shows for which part of the runs the \u03c6_cr that the published "
        "Algorithm 1 returns is at most so many \u03b5 above the \u03c6_J of its own branch; "
        "the algorithm promises 1. "
        "Right, how often \u03c6_cr from the same start is within \u03b5 of the reference's, "
        "with Wilson's 95 % interval, which takes runs as independent: those of one seed at "
        "several tolerances are not."),
}


@Figure("quality")
def QualityFigure(quality_csv):
  """Of `compare`: the part of the problems that end near the best, and where the
  reference does."""
  table = ReadTable(quality_csv, ("problems", "measure", "solver", "count", "value",
                                  "fraction", "agreement", "reference", "agree",
                                  "judged", "low", "high"),
                    words=("problems", "measure", "solver", "agreement", "reference"))
  measure = table["measure"][0]
  if measure not in QUALITY_LABELS:
    raise InputError("%s:2: measure %r is none of %s" %
                     (quality_csv, measure, ", ".join(QUALITY_LABELS)))
  names = Unique(table["solver"])
  styles = MethodStyles(names)
  labels = [Shortened(name) for name in names]
  height = 1.2 + max(3.0, 0.42 * len(names) + 0.6)
  # Room for the names and the counts beside them.
  longest = max(len(label) for label in labels)
  counts = "%d of %d" % (table["agree"].max(), table["judged"].max())
  figure, axes = RowOfPanels(2, 11.0, height, right=0.25 + 0.09 * len(counts), top=0.8,
                             wspace=0.12 + 0.024 * longest, width_ratios=(1.5, 1))
  ax = axes[0]
  curves = Distributions(table, np.ones(len(table["solver"]), bool), "value")
  values = np.concatenate([values for values, _ in curves.values()])
  if measure == "excess":
    low, high = Span(np.append(values[values > 0], 1.0))
  else:
    low, high = math.log10(ROUNDING), 0.15
  LogAxis(ax.xaxis, low, high)
  if measure == "excess":
    ax.axvline(1.0, color=GREY, linewidth=1.2, linestyle=(0, (5, 3)), zorder=1)
  for method, (values, fractions) in curves.items():
    Steps(ax, values, fractions, 10**low, 10**high, styles[method])
  FractionAxis(ax)
  ax.set_xlabel(QUALITY_LABELS[measure])
  what = table["problems"][0]
  ax.set_ylabel("%s within / %%" % ("runs" if measure == "excess" else
                                    "strains" if measure == "quality_csv" else "problems"))
  ax.set_title("%d %s" % (table["count"][0], "problems (%s)" % what if "," in what
                          else "strains" if measure == "quality_csv" else what), loc="left",
               pad=7)

  ax = axes[1]
  names = Unique(table["solver"])
  reference = table["reference"][0]
  for k, name in enumerate(names):
    row = np.nonzero(table["solver"] == name)[0][0]
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
                 "quality_csv": "with the reference all the way / %",
                 "excess": r"$\phi_{\mathrm{cr}}$ within $\epsilon$ of the reference / %"}
                [measure])
  ax.set_title("agreement", loc="left", pad=7)
  Frame(*axes.flat)
  ax.tick_params(axis="y", which="both", left=False, right=False)
  ax.grid(False, axis="y")
  MethodLegend(figure, styles)
  Help(figure, QUALITY_HELP[measure])
  return figure


@Figure("protocol", kind=("jamming", "shear"), epsilon=float)
def ProtocolFigure(kind, folder, epsilon=None, reference=""):
  """Of `compare --protocol`: what came out of whole protocols."""
  return JammingFigure(folder, epsilon) if kind == "jamming" else ShearFigure(folder, reference)


TOLERANCE_MARKERS = "osD^v"


JAMMING_HELP = (
    "Each mark is one run of the published Algorithm 1 from one seed: left, how far the "
    "state that it returns is above the jamming point of its own branch, which should be "
    "less than \u03b5 (dashed); then what growth and bisection took. "
    "Open marks are runs whose bisection halved an interval with more than one transition: "
    "the branch that it returns is jammed below a state that it called unjammed.")


def JammingFigure(folder, epsilon):
  path = folder + "/protocol_runs.csv"
  table = ReadTable(path, ("tolerance", "seed", "repetition", "solver", "finished",
                           "phi_cr", "phi_unjammed", "phi_j", "branch", "evaluations",
                           "cpu_seconds"), words=("solver", "branch"))
  if not epsilon or epsilon <= 0:
    raise InputError("--epsilon must be positive")
  names = Unique(table["solver"])
  styles = MethodStyles(names)
  tolerances = sorted(set(table["tolerance"]), reverse=True)
  solver, branch = table["solver"], table["branch"]
  excess = table["phi_cr"] - table["phi_j"]
  finished = table["finished"] > 0
  known = finished & np.isfinite(excess) & (excess > 0)
  crooked = known & (table["phi_j"] < table["phi_unjammed"] - epsilon)
  first = table["repetition"] == 1
  band = 0.8
  height = 1.5 + 0.62 * len(names) * max(1.0, 0.45 * len(tolerances))
  longest = max(len(Shortened(name)) for name in names)
  figure, axes = RowOfPanels(3, 11.0, height, left=0.33 + 0.101 * longest, top=0.72,
                             sharey=True, wspace=0.08, width_ratios=(1.5, 1, 1))
  panels = ((excess, known & first, r"$\phi_{\mathrm{cr}} - \phi_J$ of its branch"),
            (table["evaluations"], finished & first, "evaluations"),
            (table["cpu_seconds"], finished, "CPU time / s"))
  for column, (values, chosen, label) in enumerate(panels):
    ax = axes[column]
    shown = values[chosen & (values > 0)]
    low, high = Span(np.append(shown, epsilon) if column == 0 else shown)
    LogAxis(ax.xaxis, low, high)
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
  Help(figure, JAMMING_HELP)
  return figure


SHEAR_HELP = (
    "Above, the deviatoric stress under pure shear, each method relaxing its own state after "
    "each increment: as long as the curves are one, the methods answer the same question. "
    "Below, how much the energy differs from the reference's; a jump out of the "
    "rounding is a rearrangement that the two methods took differently, after which they "
    "shear different packings, neither of them wrong, until a fall shows that they have met "
    "again.")


def ShearFigure(folder, reference):
  path = folder + "/protocol_steps.csv"
  table = ReadTable(path, ("tolerance", "seed", "repetition", "solver", "strain",
                           "energy", "deviatoric_stress"), words=("solver",))
  names = Unique(table["solver"])
  # The order of the plan, whatever ran first.
  runs = ReadTable(folder + "/protocol_tables.csv", ("solver",),
                   words=("solver",)) if os.path.exists(
                       folder + "/protocol_tables.csv") else {"solver": []}
  names = [name for name in Unique(runs["solver"]) if name in names] or names
  reference = reference or names[0]
  if reference not in names:
    raise InputError("%s: no rows of the method %r" % (path, reference))
  styles = MethodStyles(names)
  solver = table["solver"]
  tolerance = table["tolerance"].min()
  seeds = sorted(set(table["seed"]))[:3]
  figure, axes = Panels(2, len(seeds), max(6.6, 0.9 + 3.9 * len(seeds)), 6.3, left=1.05,
                        top=0.9, sharex=True, sharey="row", wspace=0.08, hspace=0.1,
                        height_ratios=(1.5, 1))
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
  LogAxis(axes[1, 0].yaxis, low, high)
  axes[1, 0].set_ylabel(QUALITY_LABELS["path"])
  if len(seeds) > 1 or axes[0, 0].get_title():
    axes[0, -1].set_title("pale and wide: the reference, %s" % Shortened(reference),
                          loc="right", pad=7, fontsize=10.5, color=GREY)
  Frame(*axes.flat)
  figure.align_ylabels(axes[:, 0])
  MethodLegend(figure, styles)
  Help(figure, SHEAR_HELP)
  return figure
