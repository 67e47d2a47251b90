"""Shear: curves, plastic events, walls, stress control, damped motion."""

import math
import re
import textwrap

import numpy as np
from matplotlib import pyplot as plt
from matplotlib import ticker
from matplotlib.lines import Line2D

from figures.commands import Figure
from figures.packing_files import Describe, ReadContacts, ReadPacking, ReadVectors
from figures.packing_view import (DrawArrows, DrawFlat, DrawProjection, Key, Label,
                                  Space, View)
from figures.style import (BLUE, Decades, Frame, GREEN, GREY, Help, INK, LogAxis, Mix,
                           ORANGE, PALE, PURPLE, Panels, RowOfPanels, Scientific, Span,
                           TimesTen, VERMILION)
from figures.tables import ReadTable, ReadText, Unique

SHEAR_QUANTITIES = (
    ("stress_iso", r"isotropic stress  $\sigma_{\mathrm{iso}}$"),
    ("fabric_iso", r"isotropic fabric  $F_{\mathrm{iso}}$"),
    ("stress_dev", r"deviatoric stress  $\sigma_{\mathrm{dev}}$"),
    ("fabric_dev", r"deviatoric fabric  $F_{\mathrm{dev}}$"))
STRAIN_LABELS = {
    "pure": r"pure shear strain  $\gamma$ / %",
    "simple": r"shear strain  $\gamma$ / %",
    "bulk": r"volume strain  $V / V_0 - 1$ / %"}
FIG8_HELP = (
    "Half the sum and half the difference of the extreme eigenvalues of stress (10) and "
    "fabric (2), as in Fig. 8 of Wang and Zhang; one line for each increment of strain. "
    "Where the lines are one, the increment does not matter; after a rearrangement that "
    "one of them takes differently they are curves of different packings.")
BAND_HELP = ("Lines are means over the packings, bands reach from the 20 to the 80 % "
             "quantile.")


def IncrementColours(increments):
  order = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, INK, GREY)
  finest_first = sorted(set(increments))
  return {value: order[k % len(order)] for k, value in enumerate(finest_first)}


@Figure("shear", mode=tuple(STRAIN_LABELS), first=("stress_iso", "phi"))
def StrainFigure(curves_csv, mode="pure", first="stress_iso"):
  """Of `shear`: stress and fabric against strain, a line an increment; of several seeds
  the mean with its 20 and 80 % quantiles."""
  quantities = (SHEAR_QUANTITIES if first == "stress_iso" else
                (("phi", r"packing fraction  $\phi$"), *SHEAR_QUANTITIES[1:]))
  names = [name for name, _ in quantities]
  lines = ReadText(curves_csv).splitlines()
  bands = bool(lines) and "stress_dev_low" in lines[0]
  required = ["increment", "step", "strain", *names]
  if bands:
    required += ["curves"] + [name + end for name in names for end in ("_low", "_high")]
  table = ReadTable(curves_csv, required)
  # A curve begins at its step 0.
  starts = np.nonzero(table["step"] == 0)[0].tolist() or [0]
  pieces = [slice(a, b) for a, b in zip(starts, starts[1:] + [len(table["step"])])]
  colours = IncrementColours(table["increment"])
  figure, axes = Panels(2, 2, 10.6, 7.4, left=0.95, top=0.62, sharex=True, wspace=0.24,
                        hspace=0.09)
  count = len(pieces)
  for ax, (name, label) in zip(axes.flat, quantities):
    unit, power = TimesTen(table[name])
    for k, piece in enumerate(pieces):
      colour = colours[table["increment"][piece][0]]
      strain = 100 * table["strain"][piece]
      # The finest, last, is wide and below; coarser ones dashed on top.
      finest = k == count - 1
      style = dict(linestyle="-" if finest else ((0, (6, 2)) if k % 2 else (0, (2, 1.5))),
                   linewidth=2.4 if finest and count > 1 else 1.6)
      ax.plot(strain, table[name][piece] / unit, color=colour, zorder=3 + (not finest),
              **style)
      if bands and finest:
        ax.fill_between(strain, table[name + "_low"][piece] / unit,
                        table[name + "_high"][piece] / unit, color=colour, alpha=0.16,
                        linewidth=0, zorder=2)
    ax.set_ylabel(label + power)
    ax.margins(x=0.01)
    ax.yaxis.set_major_locator(ticker.MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
  for ax in axes[1]:
    ax.set_xlabel(STRAIN_LABELS[mode])
    ax.xaxis.set_major_locator(ticker.MaxNLocator(6, steps=[1, 2, 5, 10]))
  Frame(*axes.flat)
  figure.align_ylabels(axes[:, 0])
  figure.align_ylabels(axes[:, 1])
  handles = []
  for k, piece in enumerate(pieces):
    value = table["increment"][piece][0]
    finest = k == count - 1
    handles.append(Line2D(
        [], [], color=colours[value], linewidth=2.4,
        linestyle="-" if finest else ((0, (6, 2)) if k % 2 else (0, (2, 1.5))),
        label=r"$\delta\gamma = %s$" % re.sub(r"\.?0*\\times", r"\\times",
                                               Scientific(value))))
  figure.legend(handles=handles, loc="upper center", ncol=min(5, len(handles)),
                bbox_to_anchor=(0.535, 1.0), fontsize=13, handlelength=2.6,
                borderaxespad=0.35)
  if bands:
    Help(figure, "%s %d packings. %s" % (BAND_HELP, table["curves"].max(), FIG8_HELP))
  else:
    Help(figure, FIG8_HELP)
  return figure


EVENT_HELP = (
    "Left, what the grains do at fixed strain as the packing gives way. Right, from "
    "above: the lowest eigenvalue of the Hessian on the branch against the strain that "
    "is left (Hertz: the square root of a saddle-node; Hooke: the Hessian jumps as a "
    "contact opens, and so does the eigenvalue); the energy on the straight way from "
    "before to after; of discs, the angular harmonics of the radial displacement around "
    "the grain that moves most, by distance from it: an elastic inclusion is m = 2.")


@Figure("event")
def EventFigure(folder):
  """Of `shear --events`: the largest plastic event."""
  folder = folder + "/"
  packing = ReadPacking(folder + "event.xyz")
  contacts = ReadContacts(folder + "event_contacts.csv", packing)
  vectors = ReadVectors(folder + "event.xyz", "displacement", packing)
  branch = ReadTable(folder + "event_branch.csv", ("strain_left", "lowest_eigenvalue"),
                     may_be_empty=True)
  way = ReadTable(folder + "event_landscape.csv", ("t", "above_the_end"),
                  may_be_empty=True)
  harmonics = ReadTable(folder + "event_harmonics.csv", ("inner", "outer", "m",
                                                         "amplitude"),
                        may_be_empty=True)
  side, foot = 6.4, 0.5
  height, foot = Space(packing, side)
  total_width, head = 12.4, 0.45
  total = max(foot + height + head, 6.6)
  figure = plt.figure(figsize=(total_width, total + 0.75))
  lift = 0.75
  view = View(figure, packing, 0.1, lift + foot, side, height)
  if view.d == 2:
    DrawFlat(view, contacts._replace(force=0 * contacts.force),
             lambda: [DrawArrows(view, vectors)])
  else:
    DrawProjection(view, contacts._replace(force=0 * contacts.force))
    DrawArrows(view, vectors)
  Label(figure, 0.1 + side / 2, lift + foot + height + 0.2,
        "     ".join(Describe(packing, contacts)), side, ha="center", fontsize=12)
  Key(figure, view, contacts._replace(force=0 * contacts.force), lift + foot / 2)
  # Key() centres on the figure; under the packing it belongs.
  box = figure.artists[-1]
  box.set_bbox_to_anchor(((0.1 + side / 2) / total_width,
                          (lift + foot / 2) / (total + 0.75)), figure.transFigure)
  left, right = 7.75 / total_width, 0.985
  # Harmonics are those of discs.
  flat = len(harmonics["m"]) > 0
  third = (total - 0.9) / (3 if flat else 2)
  def Panel(k):
    bottom = lift + 0.55 + ((2 if flat else 1) - k) * (third + 0.16)
    return figure.add_axes([left, bottom / (total + 0.75), right - left,
                            (third - 0.42) / (total + 0.75)])
  ax = Panel(0)
  x, y = branch["strain_left"], branch["lowest_eigenvalue"]
  good = (x > 0) & (y > 0)
  if good.any():
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.plot(x[good], y[good], "o-", color=BLUE, markersize=5)
    low, high = Span(x[good])
    Decades(ax.xaxis, low, high)
    low, high = Span(y[good])
    LogAxis(ax.yaxis, low, high)
    if good.sum() > 3:
      end = x[good][-1], y[good][-1]
      line = np.geomspace(x[good].min(), x[good].max(), 2)
      ax.plot(line, end[1] * (line / end[0])**0.5, color=GREY, linestyle=(0, (5, 3)),
              linewidth=1.2, scalex=False, scaley=False)
  ax.set_xlabel("strain left", fontsize=12)
  ax.set_ylabel(r"$\lambda_1 / \kappa$")
  ax = Panel(1)
  unit, power = TimesTen(way["above_the_end"])
  ax.plot(way["t"], way["above_the_end"] / unit, color=VERMILION)
  ax.set_xlabel("part of the way", fontsize=12)
  ax.set_ylabel(r"$E - E_{\mathrm{after}}$" + power)
  if flat:
    ax = Panel(2)
    shells = sorted(set(harmonics["inner"]))
    width = 0.8 / len(shells)
    unit, power = TimesTen(harmonics["amplitude"])
    length = math.sqrt(abs(np.linalg.det(packing.cell)))
    for k, inner in enumerate(shells):
      of = harmonics["inner"] == inner
      ax.bar(harmonics["m"][of] + (k - (len(shells) - 1) / 2) * width,
             harmonics["amplitude"][of] / unit, width,
             color=Mix(BLUE, "#FFFFFF", 0.22 * k),
             label="%.2g" % ((inner + harmonics["outer"][of][0]) / 2 / length))
    ax.set_ylabel("amplitude" + power)
    ax.legend(title="distance / cell", fontsize=9, title_fontsize=9, ncol=2)
    ax.set_xlabel("harmonic $m$", fontsize=12)
  for ax in figure.axes[1:]:
    ax.grid(True, color=PALE, linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", top=True, right=True, labelsize=11)
  figure.text(0.1 / total_width, 0.1 / (total + 0.75),
              "\n".join(textwrap.wrap(EVENT_HELP, 168)), fontsize=9.5, color=GREY,
              va="bottom", linespacing=1.25)
  return figure


@Figure("events")
def EventsFigure(events_csv):
  """Of `shear --events`: sizes of plastic events."""
  harmonics = ["m%d" % m for m in range(5)]
  table = ReadTable(events_csv, ("energy", "energy_drop", "stress_drop",
                                 "participation", "strain_before", *harmonics))
  figure, axes = RowOfPanels(3, 13.6, 4.7, top=0.47, wspace=0.27)
  drop = np.sort(table["energy_drop"] / table["energy"])
  part = 1 - np.arange(len(drop)) / len(drop)
  ax = axes[0]
  ax.set_xscale("log")
  ax.set_yscale("log")
  ax.step(drop, part, where="post", color=BLUE, linewidth=2)
  ax.plot(drop, part, ".", color=BLUE, markersize=4)
  ax.set_xlabel(r"energy drop  $\Delta E / E$")
  ax.set_ylabel("part of the events that are larger")
  ax.set_title("%d events, median %s" % (len(drop), "$%s$" % Scientific(np.median(drop))),
               loc="left", fontsize=12)
  ax = axes[1]
  ax.set_xscale("log")
  ax.set_yscale("log")
  falls = table["stress_drop"] > 0
  for chosen, fill, label in ((falls, BLUE, "stress falls"),
                              (~falls, "white", "stress rises")):
    if chosen.any():
      ax.scatter((table["energy_drop"] / table["energy"])[chosen],
                 table["participation"][chosen], s=26, facecolor=fill,
                 edgecolor=Mix(BLUE, INK, 0.3), linewidth=0.9, label=label)
  ax.set_xlabel(r"energy drop  $\Delta E / E$")
  ax.set_ylabel("participation of the grains")
  ax.legend(fontsize=11, loc="lower right", frameon=True, framealpha=0.9)
  ax = axes[2]
  flat = table["m2"] > 0
  if flat.any():
    shares = [table[name][flat] for name in harmonics]
    for m, share in enumerate(shares):
      low, middle, high = np.quantile(share, (0.25, 0.5, 0.75))
      ax.bar(m, middle, 0.7, color=BLUE if m == 2 else Mix(BLUE, "#FFFFFF", 0.6))
      ax.vlines(m, low, high, color=INK, linewidth=1.4)
    ax.axhline(0.2, color=GREY, linestyle=(0, (5, 3)), linewidth=1.2)
    ax.set_xticks(range(5))
  ax.set_xlabel("harmonic $m$ of the far field")
  ax.set_ylabel("its part")
  Frame(*axes)
  Help(figure, "First, the cumulative distribution of the part of its energy that the "
       "packing dissipates in an event at fixed strain. Then, how many grains take part "
       "in it: 1 if all move alike, 1 / N' for a single one; open circles are events after "
       "which the packing resists more than before. Last, medians and quartiles of the angular "
       "harmonics of the radial displacement around the grain that moves most (discs): "
       "an elastic inclusion is m = 2, dashed if all were alike.")
  return figure


@Figure("walls")
def WallsFigure(folder):
  """Of `shear --mode=wall`: stresses of the wall, and how the grains follow it."""
  path = folder + "/walls.csv"
  table = ReadTable(path, ("strain", "shear_stress", "normal_stress"))
  profile = ReadTable(folder + "/profile.csv", ("height", "displacement"))
  figure, axes = RowOfPanels(3, 12.4, 4.6, wspace=0.32)
  for ax, name, label in ((axes[0], "shear_stress", r"wall shear stress  $\tau$"),
                          (axes[1], "normal_stress", "wall normal stress  $p$")):
    unit, power = TimesTen(table[name])
    ax.plot(100 * table["strain"], table[name] / unit, color=BLUE)
    ax.set_xlabel(STRAIN_LABELS["simple"])
    ax.set_ylabel(label + power)
  ax = axes[2]
  ax.plot([0, 1], [0, 1], color=GREY, linestyle=(0, (5, 3)), linewidth=1.2)
  ax.plot(profile["displacement"], profile["height"], "o-", color=VERMILION,
          markersize=5)
  ax.set_xlabel("displacement / that of the wall")
  ax.set_ylabel("height / distance of the walls")
  ax.set_ylim(0, 1)
  Frame(*axes)
  Help(figure, "What the grains exert on the upper wall, which moves along x, and, right, "
       "how far the grains have followed it at the end: dashed if the shear were even.")
  return figure


@Figure("stress")
def StressFigure(stress_csv, yields=0.0):
  """Of `shear --mode=stress`: strain, pressure and volume against shear stress."""
  table = ReadTable(stress_csv, ("strain", "shear_stress", "phi", "pressure",
                                 "coordination"))
  figure, axes = RowOfPanels(3, 12.4, 4.6, wspace=0.36)
  unit, power = TimesTen(table["shear_stress"])
  ax = axes[0]
  ax.plot(100 * table["strain"], table["shear_stress"] / unit, "o-", color=BLUE,
          markersize=4)
  if yields:
    ax.axhline(yields / unit, color=VERMILION, linestyle=(0, (5, 3)))
  ax.set_xlabel(STRAIN_LABELS["simple"])
  ax.set_ylabel(r"shear stress  $-\sigma_{12}$" + power)
  # What is held constant has nothing to show.
  at_pressure = np.ptp(table["pressure"]) < 1e-6 * table["pressure"].max()
  if at_pressure:
    values, label = table["phi"], r"packing fraction  $\varphi$"
  else:
    scale, power_y = TimesTen(table["pressure"])
    values, label = table["pressure"] / scale, "pressure  $p$" + power_y
  for ax, y, name in ((axes[1], values, label),
                      (axes[2], table["coordination"], "contacts a grain  $z$")):
    ax.plot(table["shear_stress"] / unit, y, "o-", color=BLUE, markersize=4)
    ax.set_xlabel(r"shear stress  $-\sigma_{12}$" + power)
    ax.set_ylabel(name)
    ax.ticklabel_format(axis="y", useOffset=False)
  Frame(*axes)
  Help(figure, "Minima over grains and cell at given shear stress, at constant %s%s." %
       ("pressure" if at_pressure else "volume",
        "; dashed: no state was found above" if yields else ""))
  return figure


@Figure("dynamics")
def DynamicsFigure(dynamics_csv):
  """Of `shear --dynamics`: states of damped motion against those of a minimizer."""
  names = (("energy", "$E$"), ("pressure", "$p$"),
           ("stress_dev", r"$\sigma_{\mathrm{dev}}$"),
           ("fabric_iso", r"$F_{\mathrm{iso}}$"),
           ("fabric_dev", r"$F_{\mathrm{dev}}$"), ("coordination", "$z$"))
  table = ReadTable(dynamics_csv, ("seed", "load", "way", *(n for n, _ in names)),
                    words=("load", "way"))
  load, way = table["load"], table["way"]
  loads, ways = Unique(table["load"]), [w for w in Unique(table["way"])
                                        if w != "minimizer"]
  figure, axes = RowOfPanels(len(loads), 1.2 + 3.8 * len(loads), 4.9, top=0.78,
                             sharey=True, wspace=0.07)
  colours = (BLUE, VERMILION, GREEN, ORANGE)
  for ax, which in zip(axes, loads):
    base = (load == which) & (way == "minimizer")
    order = np.argsort(table["seed"][base])
    ax.axhline(1, color=GREY, linestyle=(0, (5, 3)), linewidth=1.2, zorder=1)
    for k, one in enumerate(ways):
      chosen = (load == which) & (way == one)
      mine = np.argsort(table["seed"][chosen])
      for column, (name, _) in enumerate(names):
        reference = table[name][base][order]
        ratio = table[name][chosen][mine] / np.where(reference > 0, reference, np.nan)
        x = column + (k - (len(ways) - 1) / 2) * 0.22
        ax.plot(np.full(len(ratio), x), ratio, ".", color=Mix(colours[k % 4], "#FFFFFF", 0.5),
                markersize=5, zorder=2)
        error = np.nanstd(ratio, ddof=1) / math.sqrt(len(ratio)) if len(ratio) > 1 else 0
        ax.errorbar([x], [np.nanmean(ratio)], yerr=[error], color=colours[k % 4],
                    marker="o", markersize=6, capsize=3, zorder=4)
    ax.set_title(which, fontsize=12.5, loc="left")
    ax.set_xticks(range(len(names)))
    ax.set_xticklabels([label for _, label in names], fontsize=11)
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter(ticker.FormatStrFormatter("%g"))
    ax.yaxis.set_minor_formatter(ticker.NullFormatter())
  low, high = axes[0].get_ylim()
  # A stress that nearly vanishes says little by its ratio.
  low = max(low, 0.05)
  axes[0].set_ylim(low, high)
  choice = ((0.1, 0.2, 0.5, 1, 2, 5, 10) if high / low > 4 else
            (0.5, 0.7, 0.8, 0.9, 1, 1.1, 1.2, 1.4, 2) if high / low > 1.1 else
            (0.96, 0.98, 1, 1.02, 1.04))
  axes[0].yaxis.set_major_locator(
      ticker.FixedLocator([t for t in choice if low <= t <= high]))
  axes[0].set_ylabel("ratio to the minimizer's")
  Frame(*axes)
  figure.legend(handles=[Line2D([], [], color=colours[k % 4], marker="o", linestyle="",
                                markersize=7, label=one.replace("motion c=", "$c = ") + "$")
                         for k, one in enumerate(ways)],
                loc="upper center", ncol=len(ways), bbox_to_anchor=(0.535, 1.0),
                fontsize=12.5, title=None)
  Help(figure, "Damped Newtonian motion from rest, from the same start as the minimizer; "
       "c in units of the root of stiffness times mass. Small points: single packings, "
       "large ones their mean with its standard error.")
  return figure
