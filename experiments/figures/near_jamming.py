"""What the distance to jamming does to methods and preconditioners."""

import math

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.lines import Line2D

from figures.commands import Figure
from figures.comparison import Levels, StrainText
from figures.style import (BLUE, Decades, FOG, Frame, GREY, Help, INK, LogAxis,
                           MethodLegend, MethodStyles, ORANGE, Panels, RowOfPanels, SKY,
                           Span)
from figures.tables import Chosen, InputError, ReadTable, Unique


def StepTable(path, level, steps, numbers):
  """Of that kind of steps at the first level."""
  table = ReadTable(path, ("asked_distance", "kind", "level", "steps_kind", "solver",
                           "steps", "failed", *numbers),
                    words=("kind", "solver", "steps_kind"))
  absolute, value = Levels(level)[0]
  chosen = table["steps_kind"] == steps
  chosen &= table["kind"] == ("absolute" if absolute else "relative")
  if value is not None:
    chosen &= np.isclose(table["level"], value, rtol=1e-9, atol=0)
  if not chosen.any():
    raise InputError("%s: no rows of such steps at that level" % path)
  return Chosen(table, chosen)


DISTANCES_HELP = (
    "Each mark is the work of a shear step at one distance from jamming; a method whose marks "
    "stay level does not feel it, one that rises to the left slows down with the exponent "
    "given beside the panel. "
    "A step that failed, of which the strip on top has the number, is infinitely expensive in "
    "the medians, so a method is cheap only where it has none there.")


@Figure("distances")
def DistancesFigure(step_tables_csv, steps="all", level=()):
  """Of `compare`: what shear steps cost against the distance to jamming. A column for
  each strain. Filled: medians over the steps; light: the worst one. In the strip above:
  how many steps failed, a line a method; open: half of them did, at what the median one
  had spent. Lines: least squares of the logarithm of the median against that of the
  distance, over the points of which no step ended unjammed; the others are pale."""
  quantities = (("iterations", "iterations", "spent_iterations"),
                ("factorizations", "factorizations", "spent_factorizations"),
                ("CPU time / s", "cpu_seconds", "spent_seconds"))
  numbers = [name for _, *names in quantities for name in
             (names[0], names[0] + "_worst", names[1], names[1] + "_worst")]
  table = StepTable(step_tables_csv, level, steps,
                    ("strain", "relative", "unjammed", *numbers))
  quantities = [quantity for quantity in quantities
                if (table[quantity[2] + "_worst"] > 0).any()]
  strains = Unique(zip(table["relative"], table["strain"]))
  styles = MethodStyles(Unique(table["solver"]))
  x_low, x_high = Span(table["asked_distance"])
  rows, columns = len(quantities), len(strains)
  figure, axes = Panels(rows, columns, 0.85 + 5.4 * columns, 1.28 + 2.95 * rows,
                        right=1.4, top=0.85, sharex=True, sharey="row", wspace=1.4 / 4.0, hspace=0.1)
  for row, (label, name, spent) in enumerate(quantities):
    values = np.concatenate([table[key] for key in
                             (name, name + "_worst", spent, spent + "_worst")])
    low, high = Span(values[np.isfinite(values) & (values > 0)])
    # A strip for the failures, in which each method that fails has its own line.
    failing = [method for method in styles if
               ((table["solver"] == method) & (table["failed"] > 0) &
                (table[spent + "_worst"] > 0)).any()]
    strip = 0.02 * (high - low) * (1.5 + 5 * len(failing)) if failing else 0.0
    for column, strain in enumerate(strains):
      ax = axes[row, column]
      here = ((table["relative"] == strain[0]) & (table["strain"] == strain[1]))
      fits = []
      for k, (method, (colour, dashes, marker)) in enumerate(styles.items()):
        mine = np.nonzero(here & (table["solver"] == method))[0]
        # Work of a kind that the method does not do.
        if not (table[spent + "_worst"][mine] > 0).any():
          continue
        distance = table["asked_distance"][mine]
        # Side by side.
        x = distance * 10**(min(0.06, 0.4 / len(styles)) * (k - (len(styles) - 1) / 2))
        y, worst = table[name][mine], table[name + "_worst"][mine]
        good = np.isfinite(y) & (y > 0)
        pale = table["unjammed"][mine] > 0
        failed = table["failed"][mine]
        at = np.where(good, y, table[spent][mine])
        above = (10**(high + strip * (1 - (failing.index(method) + 0.5) / len(failing)))
                 if method in failing else np.inf)
        top = np.where(np.isfinite(worst), worst, above)
        ax.vlines(x, at, top, color=colour, linewidth=0.9, alpha=0.35, zorder=2)
        seen = np.isfinite(worst) & (worst > y)
        ax.plot(x[seen], worst[seen], color=colour, linestyle="", marker=marker,
                markersize=4.5, alpha=0.4, markeredgewidth=0, zorder=3)
        for some, style in ((good & ~pale, {}), (good & pale, {"alpha": 0.45})):
          ax.plot(x[some], y[some], color=colour, linestyle="", marker=marker,
                  markersize=6.5, zorder=4, **style)
        ax.plot(x[~good], at[~good], color=colour, linestyle="", marker=marker,
                markersize=7, markerfacecolor="white", markeredgewidth=1.4, zorder=4)
        for place, count in zip(x[failed > 0], failed[failed > 0]):
          ax.text(place, above, "%d" % count, color=colour, fontsize=10,
                  fontweight="bold", ha="center", va="center", zorder=5,
                  bbox=dict(boxstyle="square,pad=0.1", facecolor=FOG, linewidth=0))
        some = good & ~pale
        text = "\u2013"
        if some.sum() > 2:
          u, v = np.log(distance[some]), np.log(y[some])
          slope, offset = np.polyfit(u, v, 1)
          rest = v - slope * u - offset
          error = math.sqrt(np.sum(rest**2) / (len(u) - 2) / np.sum((u - u.mean())**2))
          ends = np.array([u.min(), u.max()])
          ax.plot(np.exp(ends), np.exp(offset + slope * ends), color=colour,
                  linestyle=dashes, linewidth=1.3, zorder=3)
          text = ("%+.2f \u00b1 %.2f" % (slope, error)).replace("-", "\u2212")
        fits.append((colour, marker, text))
      LogAxis(ax.xaxis, x_low, x_high)
      LogAxis(ax.yaxis, low, high, high + strip)
      if failing:
        ax.axhspan(10**high, 10**(high + strip), color=FOG, linewidth=0, zorder=1)
        ax.text(1.02, 1.0 - 0.5 * strip / (high + strip - low), "steps that failed",
                transform=ax.transAxes, fontsize=9.5, color=GREY, ha="left",
                va="center", rotation=0)
      # The exponents, beside the panel.
      line = 0.074
      first = 0.5 + 0.5 * line * len(fits)
      ax.text(1.02, first, r"$\propto \Delta\phi^{\,x}$ with $x =$",
              transform=ax.transAxes, fontsize=10, color=GREY, va="center")
      for k, (colour, marker, text) in enumerate(fits):
        y_text = first - line * (k + 1.1)
        ax.plot([1.045], [y_text], transform=ax.transAxes, color=colour, marker=marker,
                markersize=5, clip_on=False)
        ax.text(1.075, y_text, text, transform=ax.transAxes, fontsize=10.5,
                color=colour, va="center")
      if column == 0:
        ax.set_ylabel(label)
      if row == 0:
        value = "%g" % strain[1]
        if strain[1] < 1e-3:
          value = np.format_float_scientific(strain[1], trim="-")
        value += "x" if strain[0] else ""
        counts = sorted(set(table["steps"][here].astype(int)))
        count = "\u2013".join("%d" % c for c in Unique((counts[0], counts[-1])))
        ax.set_title(r"$\gamma = %s$" % StrainText(value), loc="left", pad=7)
        ax.set_title("%s steps at each $\\Delta\\phi$" % count, loc="right", pad=7,
                     fontsize=10.5, color=GREY)
      if row == rows - 1:
        ax.set_xlabel(r"distance to jamming  $\Delta\phi = \phi - \phi_J$")
  Frame(*axes.flat)
  figure.align_ylabels(axes[:, 0])
  MethodLegend(figure, styles, markers=True)
  text = "Filled: medians of %ssteps; small and light: the worst one" % (
      "" if steps == "all" else steps + " ")
  if (table["unjammed"] > 0).any():
    text += "; pale, not in the fits: some end unjammed"
  if not np.isfinite(table["iterations"]).all():
    text += "; open: half of them fail"
  Help(figure, text + ". " + DISTANCES_HELP)
  return figure


@Figure("fig7")
def Fig7Figure(step_tables_csv, level=()):
  """Of `compare --paper=fig7`: means and standard deviations of the same."""
  panels = (("iterations", "iterations"), ("seconds", "CPU time / s"))
  numbers = [name + end for name, _ in panels for end in ("_mean", "_deviation")]
  table = StepTable(step_tables_csv, level, "all", numbers)
  styles = MethodStyles(Unique(table["solver"]))
  figure, axes = RowOfPanels(2, 12.2, 5.58, left=0.9, top=0.75, wspace=0.18)
  x_low, x_high = Span(table["asked_distance"])
  for ax, (name, label) in zip(axes, panels):
    mean, deviation = table[name + "_mean"], table[name + "_deviation"]
    for k, (method, (colour, dashes, marker)) in enumerate(styles.items()):
      mine = np.nonzero(table["solver"] == method)[0]
      x = table["asked_distance"][mine] * 10**(0.035 * (k - (len(styles) - 1) / 2))
      y, spread = mean[mine], np.nan_to_num(deviation[mine])
      ax.errorbar(x, y, yerr=(np.minimum(spread, 0.9 * y), spread), color=colour,
                  linestyle=dashes, linewidth=1.3, marker=marker, markersize=6.5,
                  elinewidth=1.0, capsize=3, zorder=4)
    low, high = Span(np.concatenate([mean[mean > 0], (mean + np.nan_to_num(deviation))]))
    LogAxis(ax.xaxis, x_low, x_high)
    LogAxis(ax.yaxis, low, high)
    ax.set_xlabel(r"distance to jamming  $\phi - \phi_J$")
    ax.set_ylabel(label)
  Frame(*axes.flat)
  MethodLegend(figure, styles, markers=True)
  failed = int(table["failed"].sum())
  Help(figure, "The paper\u2019s Fig. 7: means over %d shear steps at each distance; bars: "
       "standard deviations, over packings and steps, downwards at most to a tenth. The "
       "paper\u2019s own curves, the first two, fall from 10\u00b3\u201310\u2074 iterations at 1e-6 to "
       "hundreds at 1e-2.%s" %
       (table["steps"].max(),
        " %d runs that gave up count with what they spent." % failed
        if failed else ""))
  return figure


@Figure("conditioning")
def ConditioningFigure(conditioning_csv, contact_changes_csv):
  """Of `compare`: condition numbers and contact changes against the distance to
  jamming. Above: condition numbers of fresh P and of P from before each shear step, on
  one scale; below: the parts of the contacts that change. Lines: medians over the
  packings; bars: from the least to the largest."""
  table = ReadTable(conditioning_csv, ("distance", "preconditioner", "shear", "found",
                                       "condition"), words=("preconditioner", "shear"))
  changes = ReadTable(contact_changes_csv, ("distance", "shear", "relaxed", "contacts",
                                            "deformed_opened", "deformed_closed",
                                            "step_opened", "step_closed",
                                            "newton_opened", "newton_closed",
                                            "newton_first", "predicted_opened",
                                            "predicted_closed", "message"),
                      words=("shear", "message"))
  which, label = table["shear"], table["preconditioner"]
  good = (table["found"] > 0) & np.isfinite(table["condition"])
  broken = (table["found"] > 0) & ~np.isfinite(table["condition"])
  if not good.any():
    raise InputError("%s: no condition number is finite" % conditioning_csv)
  styles = MethodStyles(Unique(table["preconditioner"]))
  shears = Unique(changes["shear"])
  x_low, x_high = Span(table["distance"])
  low, high = Span(table["condition"][good])
  low = min(low, -0.3)
  columns = 1 + len(shears)
  width, height = 1.0 + 4.35 * columns, 9.6
  figure = plt.figure(figsize=(width, height))
  grid = figure.add_gridspec(2, columns, left=0.85 / width, right=1 - 0.15 / width,
                             top=1 - 1.0 / height, bottom=0.75 / height, wspace=0.07,
                             hspace=0.26, height_ratios=(1.35, 1.0))
  upper = [figure.add_subplot(grid[0, 0])]
  upper += [figure.add_subplot(grid[0, c], sharey=upper[0]) for c in range(1, columns)]
  strip = 0.07 * (high - low) if broken.any() else 0.0
  for ax, shear in zip(upper, ["-", *shears]):
    for k, (name, (colour, dashes, marker)) in enumerate(styles.items()):
      mine = (which == shear) & (label == name)
      shift = 10**(0.035 * (k - (len(styles) - 1) / 2))
      points = []
      for distance in Unique(table["distance"][mine & good]):
        values = table["condition"][mine & good & (table["distance"] == distance)]
        points.append((distance, np.median(values), values.min(), values.max()))
      if points:
        x, y, least, most = np.array(points).T
        ax.vlines(x * shift, least, most, color=colour, linewidth=1.0, alpha=0.45)
        ax.plot(x * shift, y, color=colour, linestyle=dashes, marker=marker,
                markersize=6, linewidth=1.7)
      bad = Unique(table["distance"][mine & broken])
      ax.plot(np.array(bad) * shift, [10**(high + 0.5 * strip)] * len(bad), color=colour,
              linestyle="", marker=marker, markersize=6, markerfacecolor="white",
              markeredgewidth=1.4, zorder=4)
    if strip:
      ax.axhspan(10**high, 10**(high + strip), color=FOG, linewidth=0, zorder=0)
      if ax is upper[0]:
        ax.text(0.98, 1 - 0.5 * strip / (high + strip - low),
                "not positive definite", color=GREY, fontsize=9.5, ha="right",
                va="center", transform=ax.transAxes)
    LogAxis(ax.xaxis, x_low, x_high)
    LogAxis(ax.yaxis, low, high, high + strip)
    ax.axhline(1.0, color=GREY, linewidth=0.8, zorder=1)
    ax.set_title("P is fresh" if shear == "-" else
                 r"P from before a step $\gamma = %s$" % StrainText(shear), loc="left", pad=7)
    if ax is not upper[0]:
      ax.tick_params(labelleft=False)
  upper[0].set_ylabel(r"condition number of $P^{-1}H$")

  # Parts of the contacts, on a scale that has a zero.
  contacts = changes["contacts"]
  known = np.array([not message for message in changes["message"]])
  relaxed = changes["relaxed"] > 0
  parts = (
      ("met on the way of Newton's first step", INK, "D", (0, (5, 1.5)),
       changes["newton_opened"] + changes["newton_closed"], known),
      ("the affine deformation makes", ORANGE, "^", "-",
       changes["deformed_opened"] + changes["deformed_closed"], contacts > 0),
      ("linear response of the state before predicts", SKY, "v",
       (0, (6, 1.5, 1.2, 1.5)),
       changes["predicted_opened"] + changes["predicted_closed"],
       changes["predicted_opened"] >= 0),
      ("the whole step, once relaxed", BLUE, "o", "-",
       changes["step_opened"] + changes["step_closed"], relaxed))
  floor = 0.3 / contacts.max()
  lower = [figure.add_subplot(grid[1, c], sharex=upper[c]) for c in range(1, columns)]
  for ax, shear in zip(lower, shears):
    for k, (_, colour, marker, dashes, count, some) in enumerate(parts):
      mine = some & (changes["shear"] == shear)
      shift = 10**(0.05 * (k - 1.5))
      points = []
      for distance in Unique(changes["distance"][mine]):
        here = mine & (changes["distance"] == distance)
        part = np.maximum(count[here] / contacts[here], floor)
        points.append((distance, np.median(part), part.min(), part.max()))
      if not points:
        continue
      x, y, least, most = np.array(points).T
      ax.vlines(x * shift, least, most, color=colour, linewidth=1.0, alpha=0.45)
      ax.plot(x * shift, y, color=colour, linestyle=dashes, marker=marker, markersize=6)
    ends = math.log10(floor) - 0.2, math.log10(4.0)
    LogAxis(ax.xaxis, x_low, x_high)
    ax.set_yscale("log")
    ax.set_ylim(10**ends[0], 10**ends[1])
    Decades(ax.yaxis, math.log10(floor) + 0.4, 0.0, zero=floor)
    ax.axhspan(10**ends[0], floor * 1.5, color=FOG, linewidth=0, zorder=0)
    ax.set_title(r"contacts changed, $\gamma = %s$" % StrainText(shear), loc="left", pad=7)
    if ax is lower[0]:
      ax.set_ylabel("changes / contacts")
    else:
      ax.tick_params(labelleft=False)
  Frame(*upper, *lower)
  for ax in [upper[0], *lower]:
    ax.set_xlabel(r"distance to jamming  $\Delta\phi = \phi - \phi_J$")
  # The free place under the first panel says what is what.
  handles = [Line2D([], [], color=colour, linestyle=dashes, marker=marker, markersize=6,
                    linewidth=1.7, label=name)
             for name, colour, marker, dashes, _, _ in parts]
  place = grid[1, 0].get_position(figure)
  figure.legend(handles=handles, loc="upper left", fontsize=11, handlelength=2.6,
                title="contacts that open or close", alignment="left",
                title_fontsize=12, labelspacing=0.75, borderaxespad=0.0,
                bbox_to_anchor=(place.x0 - 0.045, place.y1 - 0.055))
  MethodLegend(figure, styles, markers=True)
  figure.text(place.x0 - 0.04, 0.2 / height, "lines: medians over packings;\n"
              "bars: least to largest", color=GREY, fontsize=10.5, va="bottom")
  return figure
