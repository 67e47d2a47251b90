"""Identification of the near field from a signal."""

import itertools

import numpy as np
import matplotlib

from figures.commands import Figure
from figures.style import BLUE, Band, Frame, GREEN, Help, INK, ORANGE, Panels, VERMILION
from figures.tables import InputError, Parameters, ReadTable, Unique


def ManyPanels(count, columns, width, height, **margins):
  """The first `count` of so many columns, framed."""
  figure, axes = Panels(-(-count // columns), columns, width, height, wspace=0.28,
                        hspace=0.32, **margins)
  Frame(*axes.flat)
  for ax in axes.flat[count:]:
    ax.set_visible(False)
  return figure, axes.flat[:count]


@Figure("identify_convergence")
def IdentifyConvergenceFigure(history_csv):
  """Of `identify`: figure 7, the best value after each list of strings."""
  table = ReadTable(history_csv, ("list", "strings", "best", "list_mean", "fresh",
                                  "fresh_error"))
  figure, (ax,) = ManyPanels(1, 1, 7.6, 5.03)
  x = table["list"]
  ax.step(x, table["best"], where="post", color=BLUE, label="best, as the search reports it")
  ax.plot(x, table["best"], "o", color=BLUE, markersize=4)
  known = np.isfinite(table["fresh"])
  ax.errorbar(x[known], table["fresh"][known], 1.96 * table["fresh_error"][known],
              color=VERMILION, marker="s", markersize=4.5, linestyle=(0, (5, 1.5)), capsize=2.5,
              label="the same strings on fresh starts (95 %)")
  top = max(table["best"].max(), (table["fresh"] + 1.96 * table["fresh_error"])[known].max()
            if known.any() else 0)
  ax.set_ylim(0, 1.12 * top)
  ax.set_xlim(-0.3, x.max() + 0.3 if x.max() > 0 else 1)
  ax.xaxis.set_major_locator(matplotlib.ticker.MaxNLocator(integer=True))
  ax.set_xlabel("generation" if len(x) <= 60 else "list of strings")
  ax.set_ylabel("$P$ of the best string")
  ax.legend(loc="upper right")
  Help(figure, "Figure 7 of the paper: the least value so far. It is a mean over few "
       "starts, picked as the least of many: on starts that the search has not seen the "
       "same strings do worse, and later gains may be none.")
  return figure


@Figure("identify_response")
def IdentifyResponseFigure(response_csv):
  """Of `identify`: figure 8, the energies that the best string makes, and the
  target."""
  names = ["time"]
  for part in ("T", "T_b", "T_r"):
    names += [part, part + "_deviation", part + "_first", part + "_target"]
  table = ReadTable(response_csv, names)
  figure, axes = ManyPanels(3, 3, 12.6, 4.33)
  t = table["time"]
  for ax, part, label, colour in zip(
      axes, ("T", "T_b", "T_r"), ("all, $T$", "bulk, $T_b$", "relative, $T_r$"),
      (INK, BLUE, VERMILION)):
    Band(ax, t, table[part], table[part + "_deviation"], colour, "mean")
    ax.plot(t, table[part + "_first"], color=colour, linewidth=0.8, label="one start")
    ax.plot(t, table[part + "_target"], color=GREEN, linestyle=(0, (5, 1.5)), label="target")
    ax.set_title(label, loc="left", pad=6)
    ax.set_xlim(t.min(), t.max())
    ax.set_ylim(0, 1.12 * max((table[part] + table[part + "_deviation"]).max(),
                              table[part + "_target"].max()))
    ax.set_xlabel("time / s")
  axes[0].set_ylabel("energy per mass / J kg$^{-1}$")
  axes[0].legend(loc="lower right", fontsize=11)
  Help(figure, "Figure 8 of the paper: kinetic energy per mass with the identified "
       "parameters, of all motion, of the centre of mass and relative to it, mean and "
       "standard deviation over 20 starts. Every start begins away from the target; the area "
       "between is a floor of $P$.")
  return figure


@Figure("identify_valley")
def IdentifyValleyFigure(fresh_csv, strings_csv):
  """Of `identify`: pairs of parameters, every string of the search and those that are
  equally good."""
  fresh_known = ("origin", "reported", "fresh", "fresh_error", "above_best",
                 "above_best_error", "equal")
  names = Parameters(fresh_csv, fresh_known)
  if not names:
    raise InputError("%s: no parameters" % fresh_csv)
  fresh = ReadTable(fresh_csv, (*fresh_known, *names), words=("origin",),
                    may_be_empty=True)
  every = ReadTable(strings_csv, ("stage", "mean", *names), words=("stage",),
                    may_be_empty=True)
  origin = fresh["origin"]
  own = (origin == "search") | (origin == "gradient")
  searched = every["stage"] == "search"
  value = every["mean"]
  searched &= np.isfinite(value)
  pairs = list(itertools.combinations(names, 2)) or [(names[0], names[0])]
  columns = min(3, len(pairs))
  rows = -(-len(pairs) // columns)
  figure, axes = ManyPanels(len(pairs), columns, 4.1 * columns + 0.6, 3.5 * rows + 1.03)
  low = value[searched].min() if searched.any() else 0.0
  norm = matplotlib.colors.LogNorm(low, max(10 * low, low + 1e-12)) if low > 0 else None
  shades = matplotlib.colors.LinearSegmentedColormap.from_list(
      "valley", ["#173F5F", "#5E9BC8", "#C9D6DF", "#ECECEC"])
  order = np.argsort(-value[searched], kind="stable")
  marks = None
  for ax, (a, b) in zip(axes, pairs):
    marks = ax.scatter(every[a][searched][order], every[b][searched][order],
                       c=value[searched][order], cmap=shades, norm=norm, s=20, linewidths=0)
    equal = own & (fresh["equal"] > 0)
    ax.scatter(fresh[a][equal], fresh[b][equal], facecolors="none", edgecolors=VERMILION,
               s=62, linewidths=1.5, label="not told from the best")
    table = np.array([word.startswith("Table") for word in fresh["origin"]])
    if table.any():
      ax.scatter(fresh[a][table], fresh[b][table], marker="x", color=ORANGE, s=44,
                 linewidths=1.8, label="Table 1 of the paper")
    known = origin == "known"
    if known.any():
      ax.scatter(fresh[a][known], fresh[b][known], marker="*", color=GREEN, s=170,
                 label="known")
    best = np.flatnonzero(own)[:1]
    ax.scatter(fresh[a][best], fresh[b][best], marker="+", color=INK, s=90, linewidths=1.8,
               label="best")
    ax.set_xlabel(a)
    ax.set_ylabel(b)
  axes[0].legend(loc="best", fontsize=9.5, frameon=True, framealpha=0.85, edgecolor="none")
  key = 3.0 if marks is not None else 0.0
  Help(figure, "Strings of the search by two of their parameters. Red rings: strings that "
       "fresh starts do not tell from the best. Where they lie along a line only a "
       "combination of the two parameters is determined, and no number of either.", key)
  if marks is not None:
    width, height = figure.get_size_inches()
    bar = figure.colorbar(marks, orientation="horizontal", extend="max", cax=figure.add_axes(
        ((width - 2.6) / width, 0.38 / height, 2.2 / width, 0.12 / height)))
    bar.set_label("$P$ in the search", fontsize=9, labelpad=1)
    if norm is not None:
      bar.ax.minorticks_off()
      ticks = [low * factor for factor in (1, 2, 5, 10)]
      bar.set_ticks(ticks, labels=["%.2g" % tick for tick in ticks])
    bar.ax.tick_params(labelsize=9)
  return figure


@Figure("identify_profile")
def IdentifyProfileFigure(profile_csv):
  """Of `identify`: the least value at fixed values of each parameter."""
  known = ("parameter", "P", "error", "best", "best_error")
  table = ReadTable(profile_csv, (*known, "value"), words=("parameter",))
  parameter = table["parameter"]
  names = Unique(table["parameter"])
  columns = min(4, len(names))
  rows = -(-len(names) // columns)
  figure, axes = ManyPanels(len(names), columns, 3.1 * columns + 1.0, 3.3 * rows + 1.03)
  finite = np.isfinite(table["P"])
  top = min(table["P"][finite].max(), 4 * table["best"][0]) if finite.any() else 1
  for ax, name in zip(axes, names):
    k = parameter == name
    best, error = table["best"][0], 1.96 * table["best_error"][0]
    ax.axhspan(best - error, best + error, color=GREEN, alpha=0.18, linewidth=0)
    ax.axhline(best, color=GREEN, linewidth=1.2, linestyle=(0, (5, 1.5)))
    ax.errorbar(table["value"][k], table["P"][k], 1.96 * table["error"][k], color=BLUE,
                marker="o", markersize=5, capsize=2.5)
    ax.set_ylim(0, 1.1 * top)
    ax.set_xlabel(name)
  axes[0].set_ylabel("least $P$, others free")
  Help(figure, "The least value that was found with one parameter held fixed and the "
       "others searched, on 20 fresh starts (95 %); green: the best of all. A parameter "
       "is determined only as far as its curve leaves the green band.")
  return figure


@Figure("identify_alternatives")
def IdentifyAlternativesFigure(alternatives_csv):
  """Of `identify`: searches with as many runs, what they report and what fresh starts
  say."""
  table = ReadTable(alternatives_csv, ("method", "runs", "reported", "fresh",
                                       "fresh_error"), words=("method",))
  method = table["method"]
  names = Unique(table["method"])
  figure, (ax,) = ManyPanels(1, 1, 9.4, 0.52 * len(names) + 1.63, left=2.6)
  for y, name in enumerate(names):
    k = method == name
    ax.plot(table["reported"][k], np.full(k.sum(), y), "o", markerfacecolor="none",
            color=BLUE, label="reported" if y == 0 else None)
    ax.errorbar(table["fresh"][k], y + 0.12 * (np.arange(k.sum()) - (k.sum() - 1) / 2),
                xerr=1.96 * table["fresh_error"][k], fmt="s", color=VERMILION, markersize=5,
                capsize=2.5, label="on fresh starts (95 %)" if y == 0 else None)
  ax.set_yticks(range(len(names)), names)
  ax.set_ylim(len(names) - 0.4, -0.9)
  ax.set_xlim(0, None)
  ax.set_xlabel("$P$ of the best string")
  ax.legend(loc="upper left", ncol=2, fontsize=11)
  Help(figure, "The best string of each search, all with the same number of simulations: "
       "the mean that the search saw and the mean on starts that none has seen. "
       "Searches whose bars overlap are not told apart.")
  return figure
