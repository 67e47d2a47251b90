"""What accuracy costs: tradeoff, extremes, fidelity."""

import math

import numpy as np
from matplotlib import pyplot as plt
from matplotlib import ticker
from matplotlib.patches import Rectangle

from figures.commands import Figure
from figures.packing_view import SPECIES_FILLS
from figures.style import (BLUE, FLOOR, Frame, GREEN, GREY, Help, INK, LogAxis,
                           MethodLegend, MethodStyles, ORANGE, PALE, PURPLE, Panels,
                           RowOfPanels, SKY, Span, TimeUnit, VERMILION)
from figures.tables import InputError, ReadTable, Unique


# Of EXTREMES.csv: fill, ink and what it means, in order of severity.
CELLS = (("passed", "#CFE6D8", GREEN, "passed: a certified minimum, or E = 0"),
         ("stationary", "#BCD6EA", BLUE, "converged, not certified a minimum"),
         ("degraded", "#F6E7C4", "#8A5A00", "ended with this residual, and says so"),
         ("refused", "#E4E9EE", GREY, "refused, with a reason"),
         ("lost", "#E9D3E2", "#8E3C6B", "not finite, hung or crashed"),
         ("wrong", VERMILION, "white", "claims what is not so"))
FLOW_CELLS = {"passed": "passed: reached its end, energies agree",
              "stationary": "not of flows",
              "degraded": "part of the energy made or lost by the integrator"}


@Figure("extremes")
def ExtremesFigure(extremes_csv):
  """Of `extremes`: what became of every method at every extreme."""
  table = ReadTable(extremes_csv, ("extreme", "group", "solver", "cell", "residual"),
                    words=("extreme", "group", "solver", "cell"))
  extremes, methods = Unique(table["extreme"]), Unique(table["solver"])
  styles = {name: (fill, ink) for name, fill, ink, _ in CELLS}
  group_of = dict(zip(table["extreme"], table["group"]))
  cell, gap = (0.86, 0.27), 0.34
  groups = Unique(group_of[extreme] for extreme in extremes)
  width = 2.6 + cell[0] * len(methods) + 0.2
  # The key, in as many lines as it takes.
  key, x, line = [], 0.2, 0
  flows = set(methods) <= {"implicit", "verlet", "minimize"}
  for name, fill, ink, words in CELLS:
    words = FLOW_CELLS.get(name, words) if flows else words
    label = "%d  %s" % (np.sum(table["cell"] == name), words)
    if x > 0.2 and x + 0.35 + 0.085 * len(label) > width:
      x, line = 0.2, line + 1
    key.append((x, line, fill, label))
    x += 0.55 + 0.085 * len(label)
  left, top, bottom = 2.6, 0.7, 0.75 + 0.3 * line
  height = top + cell[1] * len(extremes) + gap * len(groups) + bottom
  figure = plt.figure(figsize=(width, height))
  ax = figure.add_axes([0, 0, 1, 1])
  ax.set_xlim(0, width)
  ax.set_ylim(height, 0)
  ax.set_axis_off()
  for k, method in enumerate(methods):
    ax.text(left + (k + 0.5) * cell[0], top - 0.08, method.replace("_", "\n"), ha="center",
            va="bottom", fontsize=10.5)
  at, y, last = {}, top, None
  for extreme in extremes:
    if group_of[extreme] != last:
      last = group_of[extreme]
      ax.text(0.2, y + 0.27, last, fontsize=11.5, fontweight="bold", va="bottom")
      y += gap
    ax.text(left - 0.1, y + 0.5 * cell[1], extreme.replace("_", " "), ha="right",
            va="center", fontsize=10)
    at[extreme] = y
    y += cell[1]
  for extreme, method, state, residual in zip(table["extreme"], table["solver"],
                                              table["cell"], table["residual"]):
    if state not in styles:
      raise InputError("%s: cell %r is none of %s" % (extremes_csv, state, ", ".join(styles)))
    fill, ink = styles[state]
    x = left + methods.index(method) * cell[0]
    ax.add_patch(Rectangle((x + 0.02, at[extreme] + 0.015), cell[0] - 0.04, cell[1] - 0.03,
                           facecolor=fill, linewidth=0))
    text = {"passed": "ok", "stationary": "stationary"}.get(state, state)
    if state == "degraded":
      text = "%.0e" % residual if residual > 0 else "0"
    ax.text(x + 0.5 * cell[0], at[extreme] + 0.5 * cell[1], text, ha="center", va="center",
            fontsize=9, color=ink)
  for x, line, fill, label in key:
    y = height - bottom + 0.4 + 0.3 * line
    ax.add_patch(Rectangle((x, y - 0.09), 0.22, 0.18, facecolor=fill, linewidth=0))
    ax.text(x + 0.3, y, label, va="center", fontsize=10, color=INK)
  return figure


def Frontier(ax, points, end):
  """What none of the points (cost, error) beats, to the cost `end`."""
  front, best = [], np.inf
  for x, y in sorted(points):
    if y < best:
      front += [(x, best), (x, y)]
      best = y
  ax.plot(*zip(*(front[1:] + [(end, best)])), color=GREY, linewidth=5, alpha=0.3, zorder=1,
          solid_joinstyle="miter")


TRADED = (("pressure", "error of the pressure"), ("shear_modulus", "error of $G$ (13)"),
          ("places", "error of places, in overlaps"))


@Figure("tradeoff")
def TradeoffFigure(tradeoff_csv):
  """Of `tradeoff`: the error of what users want against CPU time."""
  names = [name for name, _ in TRADED]
  table = ReadTable(tradeoff_csv, ("scene", "seed", "solver", "precision", "tolerance",
                                   "reached", "cpu_seconds", *names),
                    words=("scene", "solver", "precision"))
  scenes = Unique(table["scene"])
  styles = MethodStyles(Unique(table["solver"]))
  scene, solver = table["scene"], table["solver"]
  precision = table["precision"]
  rows = len(scenes)
  figure, axes = Panels(rows, 3, 13.2, 1.28 + 3.9 * rows, left=0.95, right=0.2, top=0.8,
                        sharex="row", wspace=0.26, hspace=0.28)
  for row, name_of_scene in enumerate(scenes):
    here = scene == name_of_scene
    finite = here & np.isfinite(table["cpu_seconds"]) & (table["cpu_seconds"] > 0)
    if not finite.any():
      continue
    factor, unit = TimeUnit(table["cpu_seconds"][finite].max())
    x_low, x_high = Span(factor * table["cpu_seconds"][finite])
    for ax, (name, label) in zip(axes[row], TRADED):
      everything = []
      for method, (colour, _, marker) in styles.items():
        for kind in Unique(precision):
          mine = here & (solver == method) & (precision == kind)
          xs, ys = [], []
          for level in sorted(set(table["tolerance"][mine]), reverse=True):
            k = mine & (table["tolerance"] == level)
            error = table[name][k].max()
            # Where a packing did not get there, there is no error and no time.
            if math.isfinite(error) and np.isfinite(table["cpu_seconds"][k]).all():
              xs.append(factor * np.median(table["cpu_seconds"][k]))
              ys.append(max(error, FLOOR))
          if not xs:
            continue
          everything += zip(xs, ys)
          ax.plot(xs, ys, color=colour, linestyle={"double": "-", "mixed": (0, (4, 2)),
                                                   "float": (0, (1, 1.5))}[kind],
                  linewidth=1.2, marker=marker, markersize=4.5 if kind == "double" else 3,
                  zorder=3)
      if everything:
        Frontier(ax, everything, 10**x_high)
      y_low, y_high = Span(np.array([y for _, y in everything])) if everything else (-1, 0)
      LogAxis(ax.xaxis, x_low, x_high)
      LogAxis(ax.yaxis, y_low, y_high)
      ax.set_ylabel(label)
      ax.set_xlabel(unit)
      Frame(ax)
    axes[row, 0].set_title(name_of_scene, loc="left", pad=7)
  MethodLegend(figure, styles, markers=True)
  Help(figure, "A marker a decade of the tolerance, 1e-1 to 1e-13; solid: double, dashed: "
       "mixed, dotted: single precision. Errors: the largest over packings, against "
       "the minimum that the run ends in, 1e-15 at least; times: medians. Grey: what no "
       "setting beats.")
  return figure


FLOW_TRADED = (("kinetic", "error of $T(t)$, relative"),
               ("relative_part", "error of the relative part"),
               ("places", "error of places, in radii"))
FLOW_TRADED_STYLES = {
    "verlet": (VERMILION, "-", "s"), "jacobi": (BLUE, "-", "o"),
    "gauss_seidel": (SKY, (0, (5, 1.5)), "v"), "groups": (PURPLE, (0, (1.2, 1.2)), "<"),
    "relaxed": (ORANGE, (0, (6, 1.5, 1.2, 1.5)), "D"), "lbfgs": (GREEN, "-", "^")}
FLOW_TRADED_TITLES = {
    "smooth": "smooth: near field alone", "paper": "paper: impacts, (0.25, 0.125), 0.4 s",
    "strong": "strong: impacts, (0.5, 0.25), 1 s, means of starts",
    "many": "many: errors of forces alone"}


@Figure("tradeoff_flow")
def TradeoffFlowFigure(tradeoff_flow_csv):
  """Of `tradeoff --flow`: errors of a flow against CPU time."""
  table = ReadTable(tradeoff_flow_csv, ("scene", "family", "tolerance", "dt",
                                        "field_accuracy", "threads", "cpu_seconds",
                                        *[name for name, _ in FLOW_TRADED],
                                        *[name + "_is_bound" for name,
                                          _ in FLOW_TRADED]), words=("scene", "family"))
  scene, family = table["scene"], table["family"]
  steps = table["field_accuracy"] < 0
  scenes = [name for name in Unique(table["scene"]) if (steps & (scene == name)).any()]
  if not scenes:
    raise InputError("%s: no steppers" % tradeoff_flow_csv)
  names = Unique(family[steps])
  styles = {name: FLOW_TRADED_STYLES.get(name, (INK, "-", "x")) for name in names}
  rows = len(scenes)
  figure, axes = Panels(rows, 3, 13.2, 1.43 + 3.6 * rows, left=0.95, right=0.2, top=0.8,
                        sharex="row", wspace=0.27, hspace=0.32)
  for row, name_of_scene in enumerate(scenes):
    here = steps & (scene == name_of_scene) & np.isfinite(table["cpu_seconds"])
    for ax, (name, label) in zip(axes[row], FLOW_TRADED):
      ax.set_ylabel(label)
      ax.set_xlabel("CPU time / ms")
      good = here & np.isfinite(table[name]) & (table[name] > 0)
      if not good.any():
        ax.text(0.5, 0.5, "starts part from each other:\nplaces mean nothing",
                transform=ax.transAxes, ha="center", va="center", color=GREY)
        ax.set_axis_off()
        continue
      everything = []
      for stepper, (colour, dashes, marker) in styles.items():
        for tolerance in Unique(table["tolerance"][good & (family == stepper)]):
          k = good & (family == stepper) & (table["tolerance"] == tolerance)
          xs, ys = 1e3 * table["cpu_seconds"][k], table[name][k]
          order = np.argsort(-table["dt"][k])
          xs, ys = xs[order], ys[order]
          bound = table[name + "_is_bound"][k][order] > 0
          everything += zip(xs, ys)
          ax.plot(xs, ys, color=colour, linestyle=dashes, linewidth=1.1, zorder=3)
          for hollow in (False, True):
            ax.plot(xs[bound == hollow], ys[bound == hollow], color=colour, linestyle="none",
                    marker=marker, markersize=4.5, zorder=3,
                    markerfacecolor="white" if hollow else colour)
      x_low, x_high = Span(np.array([x for x, _ in everything]))
      y_low, y_high = Span(np.array([y for _, y in everything]))
      Frontier(ax, everything, 10**x_high)
      LogAxis(ax.xaxis, x_low, x_high)
      LogAxis(ax.yaxis, y_low, y_high)
      Frame(ax)
    axes[row, 0].set_title(FLOW_TRADED_TITLES.get(name_of_scene, name_of_scene), loc="left",
                           pad=7)
  MethodLegend(figure, styles, markers=True)
  Help(figure, "A line a stepper and tolerance, a marker a step, each half as long as the "
       "one before. Errors: the largest over starts against Verlet with a step some "
       "thousand times shorter, or, where starts part, those of means over starts with two "
       "standard errors; hollow: no more than what is not known of the exact flow, or than "
       "noise. Grey: what no way beats.")
  return figure


@Figure("phi_j")
def PhiJFigure(jamming_csv):
  """Of `tradeoff`: what sharper jamming points cost."""
  table = ReadTable(jamming_csv, ("seed", "solver", "tolerance", "error_bar", "error",
                                  "cpu_seconds"), words=("solver",))
  solver = table["solver"]
  styles = MethodStyles(Unique(table["solver"]))
  figure, axes = RowOfPanels(2, 12.2, 5.28, left=1.0, top=0.7, sharey=True,
                             wspace=0.08)
  factor, unit = TimeUnit(table["cpu_seconds"].max())
  error = np.maximum(table["error"], 1e-16)
  for ax, x in ((axes[0], factor * table["cpu_seconds"]), (axes[1], table["error_bar"])):
    for method, (colour, _, marker) in styles.items():
      for level in sorted(set(table["tolerance"])):
        for seed in sorted(set(table["seed"])):
          k = (solver == method) & (table["tolerance"] == level) & (table["seed"] == seed)
          k &= table["error"] > 0  # the last estimate is what it is judged by
          if k.any():
            ax.plot(x[k], error[k], color=colour, linewidth=0.9, marker=marker,
                    markersize=4, alpha=0.75)
    low, high = Span(x[x > 0])
    LogAxis(ax.xaxis, low, high)
    Frame(ax)
  low, high = Span(error[table["error"] > 0]) if (table["error"] > 0).any() else (-12, -3)
  LogAxis(axes[0].yaxis, low, high)
  limits = np.array(axes[1].get_xlim())
  axes[1].plot(limits, limits, color=GREY, linewidth=1.3, linestyle=(0, (5, 3)), zorder=1)
  axes[0].set_ylabel(r"$|\phi_J - $ the sharpest one of the run$|$")
  axes[0].set_xlabel(unit)
  axes[1].set_xlabel(r"error bar of $\phi_J$ at that moment")
  MethodLegend(figure, styles, markers=True)
  Help(figure, "Decompressions from over-jammed states, a marker a state, lines: packings and "
       "tolerances (1e-4, 1e-8). Right: below the dashed line the error is less "
       "than the error bar that the run states.")
  return figure


@Figure("fidelity")
def FidelityFigure(fidelity_csv, accuracy=0.05):
  """Of `fidelity`: what each ingredient costs, and what leaving it out changes."""
  table = ReadTable(fidelity_csv, ("model", "quantity", "mean", "difference",
                                   "difference_error", "verdict", "cpu_seconds_a_step"),
                    words=("model", "quantity", "verdict"))
  models, quantities = Unique(table["model"]), Unique(table["quantity"])
  whole = next((k for k, name in enumerate(models) if "whole)" in name or "whole:" in name), 0)
  model, quantity = table["model"], table["quantity"]
  verdict = table["verdict"]
  figure, axes = RowOfPanels(len(quantities) + 1, 13.2, 1.23 + 0.34 * len(models),
                             left=2.1, right=0.2, top=0.45, sharey=True, wspace=0.14)
  places = -np.arange(len(models))
  cost = np.array([table["cpu_seconds_a_step"][model == name][0] for name in models])
  axes[0].barh(places, cost / cost[whole], height=0.6, color=SPECIES_FILLS[0])
  axes[0].set_title("cost", loc="left", fontsize=12)
  axes[0].set_xlabel("whole model = 1")
  axes[0].set_yticks(places, models, fontsize=11)
  axes[0].set_ylim(-len(models) + 0.4, 0.6)
  colours = {"ok": GREEN, "no": VERMILION, "?": GREY}
  for ax, name in zip(axes[1:], quantities):
    size = abs(table["mean"][(model == models[whole]) & (quantity == name)][0]) or 1.0
    ax.axvspan(-100 * accuracy, 100 * accuracy, color="#E6F2EA",
               linewidth=0, zorder=0)
    ax.axvline(0, color=GREY, linewidth=0.8, zorder=1)
    for place, one in zip(places, models):
      k = np.nonzero((model == one) & (quantity == name))[0][0]
      if one == models[whole]:
        continue
      ax.errorbar(100 * table["difference"][k] / size, place,
                  xerr=200 * table["difference_error"][k] / size, color=colours[verdict[k]],
                  marker="o", markersize=5.5, capsize=3, linewidth=1.4, zorder=3)
    ax.set_title(name.replace("_", " "), loc="left", fontsize=12)
    ax.set_xlabel("change / %")
    band = 100 * accuracy
    ax.set_xscale("symlog", linthresh=2 * band)
    low, high = ax.get_xlim()
    low, high = min(low, -2 * band), max(high, 2 * band)
    ax.set_xlim(low, high)
    ax.xaxis.set_major_locator(ticker.FixedLocator(
        [tick for tick in (-1000, -100, -2 * band, 0, 2 * band, 100, 1000)
         if low <= tick <= high]))
    ax.xaxis.set_minor_locator(ticker.NullLocator())
    ax.xaxis.set_major_formatter(ticker.FuncFormatter(lambda value, _: "%g" % value))
    ax.tick_params(axis="x", labelsize=10)
  for ax in axes:
    ax.grid(True, axis="x", color=PALE, linewidth=0.6)
    ax.set_axisbelow(True)
  Help(figure, "Changes from the whole model, start by start: means and two standard "
       "errors. Band: the accuracy asked for, %g %%; green: within it, vermilion: "
       "beyond it, grey: more seeds would tell." % (100 * accuracy))
  return figure
