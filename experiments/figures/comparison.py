"""Methods compared: residuals against iterations, evaluations and time."""

import math

import numpy as np

from figures.commands import Figure
from figures.style import (Frame, GREY, Help, INK, LogAxis, MethodLegend, MethodStyles,
                           Panels, Span, TimeUnit, WorkAxis)
from figures.tables import InputError, ReadTable, Unique


def Levels(given):
  """[(is absolute, value)] of the values of --level; without any: relative."""
  levels = []
  for text in given:
    kind, _, value = text.partition(":")
    try:
      levels.append((kind == "absolute", float(value)))
    except ValueError:
      value = ""
    if kind not in ("absolute", "relative") or not value or levels[-1][1] <= 0:
      raise InputError("--level=%s must be relative:NUMBER or absolute:NUMBER" % text)
  return levels or [(False, None)]


def ChosenCases(cases, table, path):
  known = Unique(table["case"])
  chosen = cases.split(";") if cases else known
  for case in chosen:
    if case not in known:
      raise InputError("%s: no rows of the case %r" % (path, case))
  return chosen


def Typeset(number):
  """`1e-6` as a power of ten, `0.3` as it is; mathtext without the dollars."""
  mantissa, _, exponent = number.partition("e")
  if not exponent:
    return number
  return ("" if mantissa == "1" else mantissa + r"\times") + "10^{%d}" % int(exponent)


def StrainText(strain):
  """`1e-6`, or `0.3x` the distance to jamming."""
  return strain[:-1] + r"\,\Delta\phi" if strain.endswith("x") else Typeset(strain)


def CaseTitle(case):
  """`near_jamming=1e-6 at 1e-3` in words."""
  name, _, value = case.partition("=")
  value, _, distance = value.partition(" at ")
  title = name.replace("_", " ")
  if name in ("growth", "fig2"):
    title = r"growth of radii by $1 + %s$" % Typeset(value)
  elif name in ("simple_shear", "pure_shear"):
    title = r"%s $\gamma = %s$" % (title, Typeset(value))
  elif name == "random":
    title = r"random displacements up to $%s\,L$" % Typeset(value)
  elif name == "near_jamming":
    title = r"shear $\gamma = %s$ at $\Delta\phi = \phi - \phi_J = %s$" % (
        StrainText(value), Typeset(distance))
  elif name == "start":
    title = "random start"
  elif name == "user":
    title = "the input"
  return title


def ResidualLabel(absolute):
  return (r"$\max|g|\,/\,kL^{\alpha-1}$" if absolute
          else r"$\max|g|\,/\,\langle f\rangle$")


def ComparisonAxes(rows):
  """Rows of two panels that share their residuals, and room for a legend."""
  return Panels(rows, 2, 11.0, 0.95 + 3.55 * rows, left=1.05, top=0.9, sharey="row",
                wspace=0.09, hspace=0.36)


def LevelLines(ax, levels, absolute):
  for kind, value in levels:
    if value is not None and kind == absolute:
      ax.axhline(value, color=GREY, linewidth=1.0, linestyle=(0, (2, 2)), zorder=1)


CURVES_HELP = (
    "Each curve is one run, its residual against iterations (left) and CPU time (right); "
    "further down and further left is better. "
    "An iteration of one method costs more than that of another, so only the right side says "
    "who is faster, and that on this machine.")


@Figure("curves")
def CurvesFigure(curves_csv, cases="", level=()):
  """Of `compare`: residual against iterations and CPU time, a row a case. Thin: the
  residual, its least and largest values in each part of the run. Bold: the least
  residual so far. A dot is where a run got to the first level, an open one at the
  bottom where it got to E = 0, a cross where it ended otherwise."""
  table = ReadTable(curves_csv, ("case", "seed", "solver", "iteration", "cpu_seconds",
                                 "residual", "max_gradient"), words=("case", "solver"))
  levels = Levels(level)
  absolute = levels[0][0]
  cases = ChosenCases(cases, table, curves_csv)
  case, solver = table["case"], table["solver"]
  residuals = table["max_gradient" if absolute else "residual"]
  styles = MethodStyles(Unique(table["solver"]))
  figure, axes = ComparisonAxes(len(cases))
  seeds = len(np.unique(table["seed"]))
  any_gone = False
  for row, name in enumerate(cases):
    of_case = case == name
    seed = table["seed"][of_case][0]
    curves, gone = [], {}
    for method in styles:
      chosen = of_case & (solver == method) & (table["seed"] == seed)
      good = np.isfinite(residuals[chosen]) & (residuals[chosen] > 0)
      if good.any():
        curves.append((method, residuals[chosen][good],
                       table["iteration"][chosen][good],
                       table["cpu_seconds"][chosen][good]))
        # Without forces in the end: a dot at the bottom.
        last = np.nonzero(chosen)[0][-1]
        if residuals[last] == 0:
          gone[method] = table["iteration"][last], table["cpu_seconds"][last]
    shown = np.concatenate([np.array([])] + [curve[1] for curve in curves])
    shown = np.append(shown, [value for kind, value in levels
                              if kind == absolute and value is not None])
    low, high = Span(shown)
    LogAxis(axes[row, 0].yaxis, low, high)
    ends_of = [np.array([curve[2 + column][-1] for curve in curves])
               for column in range(2)]
    # A method that takes a twentieth of another's work is seen only so.
    log = len(curves) > 1 and all(ends.min() > 0 for ends in ends_of) and any(
        ends.max() > 20 * ends.min() for ends in ends_of)
    for column, ax in enumerate(axes[row]):
      ends = ends_of[column]
      factor, label = (1.0, "iterations")
      if column == 1:
        factor, label = TimeUnit(ends.max(initial=0.0))
      first = 1.0 if column == 0 else 1e-3 * ends.min(initial=np.inf) * factor
      for method, values, *work in curves:
        colour, dashes, _ = styles[method]
        x = work[column] * factor
        if log:
          x = np.maximum(x, first)
        ax.plot(x, values, color=colour, linewidth=0.6, alpha=0.45, zorder=2)
        ax.plot(x, np.minimum.accumulate(values), color=colour, linestyle=dashes,
                linewidth=1.9, zorder=3)
        least = values.min()
        if method in gone:
          x = np.array([x[-1], max(gone[method][column] * factor, first)])
          ax.plot(x, [least, 10**low], color=colour, linestyle=dashes, linewidth=1.9,
                  zorder=3)
          ax.plot(x[1:], [10**low], "o", markerfacecolor="white", clip_on=False,
                  markeredgecolor=colour, markeredgewidth=1.8, markersize=8, zorder=5)
          any_gone = True
          continue
        failed = any(kind == absolute and value is not None and least > value
                     for kind, value in levels[:1])
        ax.plot(x[-1:], [least], "X" if failed else "o", color=colour,
                markeredgecolor=INK if failed else colour, clip_on=False,
                markersize=10 if failed else 7, zorder=5 if failed else 4)
      WorkAxis(ax, first, ends.max() * factor if len(ends) else 1.0, log)
      LevelLines(ax, levels, absolute)
      ax.set_xlabel(label)
    axes[row, 0].set_ylabel(ResidualLabel(absolute))
    axes[row, 0].set_title(
        CaseTitle(name) + (", seed %d of %d" % (seed, seeds) if seeds > 1 else ""),
        loc="left", pad=7)
  Frame(*axes.flat)
  figure.align_ylabels(axes[:, 0])
  axes[0, 1].set_title("bold: least so far; thin: as it comes" +
                       ("; open dot: $E = 0$" if any_gone else ""), loc="right", pad=7,
                       fontsize=11, color=GREY)
  MethodLegend(figure, styles)
  Help(figure, CURVES_HELP)
  return figure


def QuantilesOf(values):
  """20, 50 and 80 % of values of which some may be infinite."""
  values, result = np.sort(values), []
  for fraction in (0.2, 0.5, 0.8):
    place = fraction * (len(values) - 1)
    below = int(place)
    weight = place - below
    if weight < 1e-9:
      result.append(values[below])
    elif math.isinf(values[below + 1]):
      result.append(math.inf)
    else:
      result.append(values[below] + weight * (values[below + 1] - values[below]))
  return result


WORK_HELP = (
    "A curve shows what a method had spent when it first met each residual, so at the "
    "tolerance that one needs the leftmost curve is the cheapest method. "
    "Where curves cross the best method depends on the tolerance; a curve ends where half of "
    "the runs never got further down.")


@Figure("work")
def WorkFigure(events_csv, cases="", level=()):
  """Of `compare`: the residual that a number of evaluations, a CPU time buys. Medians
  over seeds, steps and repetitions, bands of 20 to 80 %; a run that never got to a
  residual counts as infinitely expensive, so curves end where half of them failed."""
  table = ReadTable(events_csv, ("case", "seed", "step", "repetition", "solver", "kind",
                                 "level", "evaluations", "cpu_seconds"),
                    words=("case", "solver", "kind"))
  levels = Levels(level)
  absolute = levels[0][0]
  cases = ChosenCases(cases, table, events_csv)
  styles = MethodStyles(Unique(table["solver"]))
  case, solver = table["case"], table["solver"]
  of_kind = table["kind"] == ("absolute" if absolute else "relative")
  figure, axes = ComparisonAxes(len(cases))
  for row, name in enumerate(cases):
    of_case = case == name
    runs = len(set(zip(*(table[key][of_case] for key in ("seed", "step", "repetition")))))
    curves = []
    for method in styles:
      chosen = of_case & (solver == method) & of_kind
      curve = []
      for level in sorted(set(table["level"][chosen]), reverse=True):
        here = chosen & (table["level"] == level)
        missing = np.full(max(0, runs - here.sum()), np.inf)
        curve.append([level] + [QuantilesOf(np.append(table[what][here], missing))
                                for what in ("evaluations", "cpu_seconds")])
      curve = [point for point in curve if math.isfinite(point[1][1])]
      if curve:
        curves.append((method, np.array([point[0] for point in curve]),
                       np.array([point[1] for point in curve]),
                       np.array([point[2] for point in curve])))
    # What all have reached at the start says nothing, but for the last of it.
    began = [level for level in curves[0][1] if all(
        (curve[2][curve[1] == level, 1] <= 1).any() for curve in curves)] if curves else []
    curves = [(method, *(part[values <= min(began, default=np.inf)]
                         for part in (values, *work)))
              for method, values, *work in curves]
    shown = np.concatenate([np.array([])] + [curve[1] for curve in curves])
    low, high = Span(shown)
    ax = axes[row, 0]
    LogAxis(ax.yaxis, low, high)
    for column, ax in enumerate(axes[row]):
      most = max([curve[2 + column][-1, 1] for curve in curves], default=1.0)
      factor, label = (1.0, "evaluations of energy and gradient")
      if column == 1:
        factor, label = TimeUnit(most)
      # What every method has at the start says nothing.
      least = min([curve[2 + column][curve[2 + column][:, 1] > 0, 1].min(initial=most)
                   for curve in curves], default=1.0)
      first = least * factor
      for method, values, *work in curves:
        colour, dashes, marker = styles[method]
        x = np.maximum(work[column] * factor, first)
        x[~np.isfinite(x)] = 10 * most * factor
        ax.fill_betweenx(values, x[:, 0], x[:, 2], color=colour, alpha=0.15,
                         linewidth=0, zorder=2)
        ax.plot(x[:, 1], values, color=colour, linestyle=dashes, linewidth=1.7,
                marker=marker, markersize=5, zorder=3)
      WorkAxis(ax, first, most * factor, True)
      LevelLines(ax, levels, absolute)
      ax.set_xlabel(label)
    axes[row, 0].set_ylabel(ResidualLabel(absolute) + " reached")
    axes[row, 0].set_title(CaseTitle(name), loc="left", pad=7)
  Frame(*axes.flat)
  figure.align_ylabels(axes[:, 0])
  axes[0, 1].set_title("medians; bands: 20 to 80 % of the runs", loc="right", pad=7,
                       fontsize=11, color=GREY)
  MethodLegend(figure, styles, markers=True)
  Help(figure, WORK_HELP)
  return figure
