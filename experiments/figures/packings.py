"""Packings, normal modes, traces of a relaxation."""

import os

import numpy as np
from matplotlib import pyplot as plt
from matplotlib import ticker

from figures.commands import Figure
from figures.packing_files import (Describe, Rattlers, ReadContacts, ReadPacking,
                                   ReadVectors)
from figures.packing_view import (Draw, DrawArrows, DrawFlat, DrawProjection, Key,
                                  Label, Space, View)
from figures.style import (BLUE, Frame, INK, LogAxis, RowOfPanels, Scientific, Span,
                           VERMILION)
from figures.tables import InputError, ReadTable


@Figure("packing")
def PackingFigure(packing_xyz, contacts_csv, title=""):
  """Discs (3D: a projection) with force chains."""
  packing = ReadPacking(packing_xyz)
  contacts = ReadContacts(contacts_csv, packing)
  width, side = 6.6, 6.4
  height, foot = Space(packing, side)
  head = 0.76 if title else 0.42
  figure = plt.figure(figsize=(width, height + head + foot))
  view = View(figure, packing, 0.1, foot, side, height)
  Draw(view, contacts)
  Label(figure, width / 2, foot + height + 0.18,
        "     ".join(Describe(packing, contacts)), side, ha="center", fontsize=12.5)
  if title:
    Label(figure, width / 2, foot + height + 0.53, title.replace("$", r"\$"),
          side, ha="center", fontsize=15, fontweight="bold")
  Key(figure, view, contacts, foot / 2)
  return figure


@Figure("mode")
def ModeFigure(modes_xyz, contacts_csv, modes_csv, number=1):
  """Of `relax`: a normal mode, arrows on the packing."""
  packing = ReadPacking(modes_xyz)
  contacts = ReadContacts(contacts_csv, packing)
  table = ReadTable(modes_csv, ("mode", "relative_eigenvalue", "participation", "half"))
  row = np.nonzero(table["mode"] == number)[0]
  if len(row) == 0:
    raise InputError("%s: no mode %d" % (modes_csv, number))
  row = row[0]
  vectors = ReadVectors(modes_xyz, "mode_%d" % number, packing)
  width, side = 6.6, 6.4
  height, foot = Space(packing, side)
  figure = plt.figure(figsize=(width, height + 0.76 + foot))
  view = View(figure, packing, 0.1, foot, side, height)
  if view.d == 2:
    DrawFlat(view, contacts, lambda: [DrawArrows(view, vectors)])
  else:
    DrawProjection(view, contacts._replace(force=0 * contacts.force))
    DrawArrows(view, vectors)
  words = [r"$\lambda_{%d} = %s\,\kappa$" %
           (number, Scientific(table["relative_eigenvalue"][row])),
           "participation $%.2g$" % table["participation"][row],
           "half of it on %d of %d grains" %
           (table["half"][row], np.sum(~Rattlers(packing, contacts)))]
  Label(figure, width / 2, foot + height + 0.48, "     ".join(words), side, ha="center",
        fontsize=13.5)
  Label(figure, width / 2, foot + height + 0.18,
        "     ".join(Describe(packing, contacts)), side, ha="center", fontsize=11.5)
  Key(figure, view, contacts._replace(force=0 * contacts.force), foot / 2)
  return figure


@Figure("stages")
def StagesFigure(folder):
  """Of `jamming`: the initial packing, the last unjammed one and the jammed one."""
  files = ("stage_initial.xyz", "stage_unjammed.xyz", "packing.xyz", "contacts.csv")
  files = [os.path.join(folder, file) for file in files]
  packings = [ReadPacking(file) for file in files[:3]]
  contacts = ReadContacts(files[3], packings[2])
  side, gap, head = 4.1, 0.2, 0.74
  height, foot = Space(packings[2], side)
  figure = plt.figure(figsize=(3 * side + 4 * gap, height + head + foot))
  border = None
  for k in (2, 0, 1):
    packing, shown = packings[k], contacts if k == 2 else None
    left = gap + k * (side + gap)
    view = View(figure, packing, left, foot, side, height, border)
    Draw(view, shown)
    if k == 2:
      border = view.border
      Key(figure, view, contacts, foot / 2, size=14)
    top = foot + height
    Label(figure, left, top + 0.52, "abc"[k], side, fontsize=18, fontweight="bold")
    Label(figure, left + 0.3, top + 0.52, ("initial", "last unjammed", "jammed")[k],
          side, fontsize=16)
    words = Describe(packing, shown)
    Label(figure, left, top + 0.19,
          "    ".join(words[1:2] if k < 2 else words[1:2] + words[3:]), side,
          fontsize=14)
  return figure


@Figure("trace")
def TraceFigure(trace_csv):
  """Of `relax`: residual against iterations and seconds."""
  table = ReadTable(trace_csv, ("iteration", "energy", "max_gradient", "mean_force",
                                "vanishing", "seconds"))
  scale = table["mean_force"]
  residual = np.full(len(scale), np.nan)
  np.divide(table["max_gradient"], scale, out=residual, where=scale > 0)
  curves = [(r"$\max|g|\,/\,\langle f\rangle$", BLUE, "-", residual)]
  # A run that ends unjammed has no small residual, but its forces vanish: their
  # measure is shown if it fell further.
  vanishing = table["vanishing"]
  gone = table["energy"][-1] == 0
  if gone or vanishing[-1] * residual[0] < residual[-1] * vanishing[0]:
    curves.append((r"$(p\,/\,k\,\bar r^{\,\alpha-d})^{1/(\alpha-1)}$", VERMILION,
                   (0, (5, 2)), vanishing))
  for _, _, _, values in curves:
    values[~(np.isfinite(values) & (values > 0))] = np.nan
  curves = [curve for curve in curves if np.isfinite(curve[3]).any()]
  if not curves and not gone:
    raise InputError("%s: no positive residual" % trace_csv)
  shown = np.concatenate([np.array([])] + [values for _, _, _, values in curves])
  shown = shown[np.isfinite(shown)]
  figure, axes = RowOfPanels(2, 10.4, 4.4, left=1.0, top=0.22, sharey=True, wspace=0.07)
  low, high = Span(shown)
  LogAxis(axes[0].yaxis, low, high)
  seconds = table["seconds"]
  short = seconds.max() < 1
  for ax, x, label in ((axes[0], table["iteration"], "iterations"),
                       (axes[1], seconds * (1000 if short else 1),
                        "milliseconds" if short else "seconds")):
    for name, colour, dashes, values in curves:
      good = np.nonzero(np.isfinite(values))[0]
      ax.plot(x, values, color=colour, linestyle=dashes, label=name,
              linewidth=1.4 if len(good) < 5000 else 0.9,
              marker="o" if len(good) <= 40 else None, markersize=4)
      ax.plot(x[good[-1:]], values[good[-1:]], "o", color=colour, markersize=7,
              clip_on=False, zorder=4)
    if gone:
      ax.plot(x[-1:], [0.03], "o", markerfacecolor="white", markeredgecolor=INK,
              markersize=8, zorder=5, label="$E = 0$", linestyle="",
              transform=ax.get_xaxis_transform())
    ax.set_xlabel(label)
    ax.margins(x=0.03)
    ax.xaxis.set_major_locator(ticker.MaxNLocator(6, steps=[1, 2, 5, 10])
                               if np.ptp(x) > 0 else ticker.FixedLocator(x[:1]))
    ax.xaxis.set_major_formatter(ticker.FuncFormatter(
        lambda value, _: "{:,.10g}".format(value)))
    Frame(ax)
  if len(curves) == 1 and not gone:
    axes[0].set_ylabel(curves[0][0])
  else:
    axes[0].set_ylabel("residual")
    axes[1].legend(loc="best", fontsize=13, frameon=True, framealpha=0.9,
                   edgecolor="none")
  return figure
