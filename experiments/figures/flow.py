"""Near-field granular flow."""

import itertools
import math
import re

import numpy as np
import matplotlib
from matplotlib import pyplot as plt
from matplotlib.patches import Circle

from figures.commands import Figure
from figures.style import (BLUE, Band, Frame, GREEN, GREY, Help, INK, ORANGE, PURPLE,
                           Panels, RowOfPanels, SKY, VERMILION)
from figures.tables import InputError, ReadTable, ReadText, Unique


def ReadFrame(path):
  """The first frame of an extended XYZ file of `flow`: time, side, centres, radii,
  velocities."""
  lines = ReadText(path).splitlines()
  try:
    count = int(lines[0])
    values = {key: quoted or plain for key, quoted, plain in
              re.findall(r'(\w+)=(?:"([^"]*)"|(\S+))', lines[1])}
    side = float(values["Lattice"].split()[0])
    time = float(values["Time"])
    rows = np.array([[float(word) for word in line.split()[1:8]]
                     for line in lines[2:2 + count]]).reshape(count, 7)
  except (IndexError, KeyError, ValueError):
    raise InputError("%s: not a frame of spheres with velocities" % path)
  if count < 1 or not np.isfinite(rows).all():
    raise InputError("%s: no grain, or a number that is not finite" % path)
  return time, side, rows[:, :3], rows[:, 3], rows[:, 4:7]


@Figure("flow_start")
def FlowStartFigure(start_xyz):
  """Of `flow`: spheres in their cube, seen from the front, right and above; the colour
  is the velocity along the mean flow."""
  time, side, x, radii, v = ReadFrame(start_xyz)
  azimuth, elevation = math.radians(-62), math.radians(22)
  right = np.array([-math.sin(azimuth), math.cos(azimuth), 0])
  towards = np.array([math.cos(elevation) * math.cos(azimuth),
                      math.cos(elevation) * math.sin(azimuth), math.sin(elevation)])
  up = np.cross(towards, right)
  figure = plt.figure(figsize=(7.4, 6.3))
  ax = figure.add_axes((0.0, 0.0, 0.84, 0.95))
  h = 0.5 * side
  corners = np.array(list(itertools.product((-h, h), repeat=3)))
  hidden = corners[np.argmin(corners @ towards)]
  edges = [(a, b) for a, b in itertools.combinations(corners, 2)
           if np.isclose(np.abs(a - b).sum(), side)]
  for a, b in edges:
    back = np.allclose(a, hidden) or np.allclose(b, hidden)
    ax.plot([a @ right, b @ right], [a @ up, b @ up], color=GREY if back else INK,
            linewidth=0.8 if back else 1.0, linestyle=(0, (4, 3)) if back else "-",
            zorder=0 if back else 3, alpha=1.0 if back else 0.55)
  speed = v[:, 0]
  low, high = speed.min(), speed.max()
  if not high > low:
    low, high = low - 1.0, high + 1.0
  colours = matplotlib.colors.LinearSegmentedColormap.from_list(
      "flow", ["#2B5C8A", "#6FA8D0", "#E9E4D4", "#E8A15B", "#B5401F"])
  depth = x @ towards
  order = np.argsort(depth, kind="stable")
  shades = 7 if len(x) <= 2000 else 1
  span = max(np.ptp(depth), 1e-300)
  light = np.array((-0.32, 0.38))
  patches, fills = [], []
  for i in order:
    centre = np.array((x[i] @ right, x[i] @ up))
    base = np.array(matplotlib.colors.to_rgb(colours((speed[i] - low) / (high - low))))
    base = base + (1 - base) * 0.35 * (1 - (depth[i] - depth.min()) / span)
    for s in range(shades):
      t = s / shades
      patches.append(Circle(centre + light * radii[i] * t, radii[i] * (1 - t)))
      fills.append(np.clip(base * (0.62 + 0.38 * min(1, 1.6 * t)) +
                           0.55 * max(0, t - 0.55) * (1 - base), 0, 1))
  collection = matplotlib.collections.PatchCollection(patches, facecolors=fills,
                                                      edgecolors="none", zorder=2)
  ax.add_collection(collection)
  reach = side * 0.82
  ax.set_xlim(-reach, reach)
  ax.set_ylim(-reach, reach)
  ax.set_aspect("equal")
  ax.axis("off")
  ax.set_title("%d spheres at $t$ = %g s" % (len(x), time), loc="left", x=0.08)
  bar_ax = figure.add_axes((0.865, 0.24, 0.024, 0.5))
  bar = figure.colorbar(matplotlib.cm.ScalarMappable(
      matplotlib.colors.Normalize(low, high), colours), cax=bar_ax)
  bar.set_label("velocity along $x$ / m s$^{-1}$")
  return figure


FLOW_VARIANTS = (("constant_e", "$x \\to -x$, $e$ = 0.5", BLUE),
                 ("velocity_dependent_e", "$x \\to -x$, $e$ of (5.13)", ORANGE),
                 ("nearest_image", "nearest image, $e$ = 0.5", GREEN))
FLOW_STRENGTHS = ("no near field", r"$\bar\alpha$ = 0.1, 0.05",
                  r"$\bar\alpha$ = 0.25, 0.125", r"$\bar\alpha$ = 0.5, 0.25")


def FlowTable(path):
  table = ReadTable(path, ("variant", "strength", "time", "kinetic",
                           "kinetic_deviation", "relative_fraction",
                           "relative_fraction_deviation", "boundary",
                           "boundary_deviation", "first_kinetic",
                           "first_relative_fraction"), words=("variant",))
  return table, table["variant"]


def FlowPanels():
  """A panel for each strength of the near field."""
  figure, axes = Panels(2, 2, 10.4, 6.83, sharex=True, wspace=0.16, hspace=0.2)
  for number, ax in enumerate(axes.flat):
    ax.set_title("(%d)  %s" % (number + 1, FLOW_STRENGTHS[number]), loc="left", pad=6)
    Frame(ax)
    if number > 1:
      ax.set_xlabel("time / s")
  return figure, axes.flat


@Figure("flow_fractions")
def FlowFractionsFigure(energy_csv):
  """Of `flow --paper`: figure 5, the parts of bulk and relative motion in the kinetic
  energy."""
  table, variant = FlowTable(energy_csv)
  figure, axes = FlowPanels()
  for number, ax in enumerate(axes):
    k = (variant == "constant_e") & (table["strength"] == number + 1)
    t, f, d = (table[name][k] for name in ("time", "relative_fraction",
                                           "relative_fraction_deviation"))
    Band(ax, t, 1 - f, d, BLUE, "bulk")
    Band(ax, t, f, d, VERMILION, "relative", (0, (5, 1.5)))
    ax.plot(t, table["first_relative_fraction"][k], color=VERMILION, linewidth=0.8)
    ax.plot(t, 1 - table["first_relative_fraction"][k], color=BLUE, linewidth=0.8)
    ax.set_ylim(0, 1)
    ax.set_xlim(0, t.max() if len(t) else 1)
    if number % 2 == 0:
      ax.set_ylabel("part of the kinetic energy")
  axes[0].legend(loc="center right")
  Help(figure, "Figure 5 of the paper: parts of the kinetic energy in the motion of the "
       "centre of mass and relative to it, by the strength of the near field. Bands: one "
       "standard deviation of a start; thin: one start. With the strongest field relative "
       "motion dominates: a flow becomes a vibrating ensemble.")
  return figure


@Figure("flow_energy")
def FlowEnergyFigure(energy_csv):
  """Of `flow --paper`: figure 6, the kinetic energy per mass."""
  table, variant = FlowTable(energy_csv)
  figure, axes = FlowPanels()
  for number, ax in enumerate(axes):
    for name, label, colour in FLOW_VARIANTS[:2]:
      k = (variant == name) & (table["strength"] == number + 1)
      t = table["time"][k]
      Band(ax, t, table["kinetic"][k], table["kinetic_deviation"][k], colour, label,
           "-" if name == "constant_e" else (0, (5, 1.5)))
      if name == "constant_e":
        ax.plot(t, table["first_kinetic"][k], color=colour, linewidth=0.8)
    ax.set_xlim(0, t.max() if len(t) else 1)
    if number % 2 == 0:
      ax.set_ylabel("$T$ per mass / J kg$^{-1}$")
  axes[0].legend(loc="upper right")
  Help(figure, "Figure 6 of the paper: kinetic energy per mass. Bands: one standard "
       "deviation of a start; thin: one start. It falls without near field, where only "
       "impacts act, and is not monotone with one; a restitution that depends on the "
       "velocity changes little.")
  return figure


@Figure("flow_boundary")
def FlowBoundaryFigure(energy_csv):
  """Of `flow --paper`: what the paper's rule at the boundary does to the energy."""
  table, variant = FlowTable(energy_csv)
  figure, axes = FlowPanels()
  for number, ax in enumerate(axes):
    for name, label, colour in (FLOW_VARIANTS[0], FLOW_VARIANTS[2]):
      k = (variant == name) & (table["strength"] == number + 1)
      t = table["time"][k]
      if not k.any():
        continue
      Band(ax, t, table["kinetic"][k], table["kinetic_deviation"][k], colour,
           "$T$, " + label.split(",")[0])
      if name == "constant_e":
        Band(ax, t, table["boundary"][k], table["boundary_deviation"][k], VERMILION,
             "put in by the jumps so far", (0, (5, 1.5)))
    ax.axhline(0, color=GREY, linewidth=0.8)
    ax.set_xlim(0, t.max() if len(t) else 1)
    if number % 2 == 0:
      ax.set_ylabel("energy per mass / J kg$^{-1}$")
  axes[1].legend(loc="center left", fontsize=11)
  Help(figure, "The paper's rule x \u2192 \u2212x moves an outgoing grain among others "
       "without images: its potential energy jumps, and most of what the kinetic energy "
       "gains is what these jumps put in. With nearest images a crossing costs nothing, "
       "and the growth is gone.")
  return figure


@Figure("flow_run")
def FlowRunFigure(energy_csv):
  """Of `flow`: the kinetic energy of one run with its parts, and the ledger."""
  names = ("time", "kinetic", "bulk", "relative", "potential", "impact", "friction",
           "external", "damping", "boundary", "numerical")
  table = ReadTable(energy_csv, names)
  figure, axes = RowOfPanels(2, 11.4, 4.68, wspace=0.26)
  t = table["time"]
  for name, label, colour, dashes in (("kinetic", "all", INK, "-"), ("bulk", "bulk", BLUE, "-"),
                                      ("relative", "relative", VERMILION, (0, (5, 1.5)))):
    axes[0].plot(t, table[name], color=colour, linestyle=dashes, label=label)
  axes[0].set_title("kinetic energy", loc="left", pad=6)
  axes[0].set_ylim(0, None)
  axes[1].plot(t, table["kinetic"] - table["kinetic"][0], color=INK, linewidth=2.2,
               label="kinetic energy")
  axes[1].plot(t, table["potential"][0] - table["potential"], color=BLUE,
               label="from the potential")
  for name, label, colour, dashes in (
      ("boundary", "boundary", VERMILION, (0, (5, 1.5))),
      ("impact", "impact", GREEN, "-"), ("friction", "friction", SKY, (0, (1.2, 1.2))),
      ("external", "external", PURPLE, "-"), ("damping", "damping", GREY, "-"),
      ("numerical", "integrator", ORANGE, (0, (6, 1.5, 1.2, 1.5)))):
    if np.abs(table[name]).max() > 0:
      axes[1].plot(t, table[name], color=colour, linestyle=dashes, label=label)
  axes[1].axhline(0, color=GREY, linewidth=0.8)
  axes[1].set_title("where it comes from and goes to", loc="left", pad=6)
  for ax in axes:
    ax.set_xlabel("time / s")
    ax.set_ylabel("energy per mass / J kg$^{-1}$")
    ax.set_xlim(t.min(), max(t.max(), t.min() + 1e-12))
    Frame(ax)
    ax.legend(loc="best", fontsize=11, frameon=True, framealpha=0.85, edgecolor="none")
  Help(figure, "Left: the kinetic energy, of the centre of mass and relative to it. "
       "Right: the change of the kinetic energy is the sum of the other lines, to "
       "roundoff; \u201cintegrator\u201d is what finite steps take out or put in.")
  return figure


FLOW_STEPPERS = {"jacobi": (BLUE, "o"), "gauss_seidel": (SKY, "v"),
                 "groups": (PURPLE, "<"), "verlet": (VERMILION, "s"), "lbfgs": (GREEN, "^"),
                 "newton": (ORANGE, "D"), "ncg": (GREY, ">")}


@Figure("flow_work")
def FlowWorkFigure(work_csv):
  """Of `flow --study`: work and precision of the three families of steppers."""
  table = ReadTable(work_csv, ("case", "family", "stepper", "tolerance", "dt", "error",
                               "sweeps", "seconds"), words=("family", "stepper"))
  cases = Unique(table["case"])
  figure, axes = Panels(2, len(cases), 11.4, 1.13 + 3.35 * 2, left=0.95, top=0.85, sharey=True,
                        wspace=0.08, hspace=0.3)
  stepper = table["stepper"]
  handles = {}
  for column, case in enumerate(cases):
    for row, (work, label) in enumerate((("sweeps", "evaluations of all forces"),
                                         ("seconds", "CPU time / ms"))):
      ax = axes[row, column]
      for name in Unique(table["stepper"]):
        for tolerance in Unique(table["tolerance"][stepper == name]):
          k = (table["case"] == case) & (stepper == name) & (table["tolerance"] == tolerance)
          if not k.any():
            continue
          colour, marker = FLOW_STEPPERS.get(name, (INK, "x"))
          loose = name == "jacobi" and tolerance > 1e-6
          line, = ax.plot(table[work][k] * (1e3 if row else 1), table["error"][k],
                          color=colour, marker=marker, markersize=5.5, linewidth=1.5,
                          linestyle=(0, (4, 2)) if loose else "-",
                          markerfacecolor="white" if loose else colour)
          handles[name + (", TOL = %g" % tolerance if name == "jacobi" else "")] = line
      ax.set_xscale("log")
      ax.set_yscale("log")
      ax.set_xlabel(label)
      Frame(ax)
      if column == 0:
        ax.set_ylabel(r"$|T - T_{\mathrm{exact}}|\,/\,T_{\mathrm{exact}}$")
    axes[0, column].set_title(FLOW_STRENGTHS[int(case) - 1], loc="left", pad=6)
  figure.legend(handles.values(), handles.keys(), loc="upper center", ncol=len(handles),
                fontsize=11, handlelength=2.2, columnspacing=1.3, borderaxespad=0.3)
  Help(figure, "Each point is a time step; to the lower left is better. Backward Euler by "
       "any solver is limited by the step, not by the tolerance of its iteration: the "
       "dashed line with TOL = 1e-4 is as accurate as the others and cheaper. Verlet "
       "reaches the same error with two to thirteen times fewer evaluations, until "
       "contacts, which every stepper looks for once a step, limit it, too.")
  return figure


@Figure("flow_remark8")
def FlowRemarkFigure(remark8_csv):
  """Of `flow --study`: which solver still solves an implicit step, and for how much."""
  table = ReadTable(remark8_csv, ("dt", "method", "solved", "attempts", "evaluations",
                                  "indefinite"), words=("method",))
  methods = Unique(table["method"])
  figure, axes = RowOfPanels(2, 11.4, 4.78, top=0.75, wspace=0.2)
  method = table["method"]
  for name in methods:
    k = method == name
    colour, marker = FLOW_STEPPERS.get(name, (BLUE, "o"))
    dashes = (0, (4, 2)) if "," in name else "-"
    label = name.replace("gamma", r"$\gamma$")
    dt = table["dt"][k]
    axes[0].plot(dt, table["solved"][k] / table["attempts"][k], color=colour, marker=marker,
                 linestyle=dashes, markersize=5.5, label=label)
    good = table["solved"][k] > 0
    axes[1].plot(dt[good], table["evaluations"][k][good], color=colour, marker=marker,
                 linestyle=dashes, markersize=5.5)
  k = method == methods[0]
  axes[0].plot(table["dt"][k], table["indefinite"][k] / table["attempts"][k], color=INK,
               linewidth=1.0, linestyle=(0, (1.2, 1.2)), label="tangent not positive definite")
  axes[0].set_ylabel("part of the steps solved")
  axes[0].set_ylim(-0.03, 1.05)
  axes[1].set_ylabel("evaluations of all forces")
  axes[1].set_yscale("log")
  for ax in axes:
    ax.set_xscale("log")
    ax.set_xlabel(r"$\Delta t$ / s")
    Frame(ax)
  handles, labels = axes[0].get_legend_handles_labels()
  figure.legend(handles, labels, loc="upper center", ncol=4, fontsize=11, borderaxespad=0.3)
  Help(figure, "One implicit step of length \u0394t, by fixed point and by minimization of "
       "the incremental potential, impacts frozen. The fixed point is a contraction for "
       "short steps only; lbfgs, ncg and newton (all at 1 on the left) need no "
       "contraction and no positive definite tangent, and go on where the others fail. "
       "Right: medians of the steps that were solved.")
  return figure


@Figure("flow_oscillator")
def FlowOscillatorFigure(decay_csv, response_csv):
  """Of `flow --study`: free decay and forced response of a grain near its
  equilibrium."""
  decay = ReadTable(decay_csv, ("zeta", "time", "measured", "linear"))
  response = ReadTable(response_csv, ("zeta", "force", "frequency", "amplitude",
                                      "phase", "linear_amplitude", "linear_phase"))
  figure, axes = RowOfPanels(3, 12.6, 4.68, left=1.0, wspace=0.26)
  for zeta, colour in zip(Unique(decay["zeta"]), (BLUE, VERMILION, GREEN, ORANGE)):
    k = decay["zeta"] == zeta
    axes[0].plot(decay["time"][k], decay["linear"][k], color=colour, linewidth=1.4,
                 label=r"$\zeta$ = %g" % zeta)
    axes[0].plot(decay["time"][k][::12], decay["measured"][k][::12], "o", color=colour,
                 markersize=3.6)
  axes[0].set_title("free decay", loc="left", pad=6)
  axes[0].set_xlabel(r"time $\omega^*/2\pi$")
  axes[0].set_ylabel(r"$(r - r^*)\,/\,(r - r^*)_{t=0}$")
  axes[0].legend(loc="upper right")
  forces = Unique(response["force"])
  for zeta, colour in zip(Unique(response["zeta"]), (BLUE, VERMILION, GREEN)):
    for force in forces:
      k = (response["zeta"] == zeta) & (response["force"] == force)
      x = response["frequency"][k]
      small = force == min(forces)
      marker = "o" if small else "x"
      if small:
        for ax, name in ((axes[1], "linear_amplitude"), (axes[2], "linear_phase")):
          fine = np.linspace(x.min(), x.max(), 400)
          if name == "linear_amplitude":
            y = 1 / np.sqrt((1 - fine**2)**2 + (2 * zeta * fine)**2)
          else:
            y = np.arctan2(2 * zeta * fine, 1 - fine**2)
          ax.plot(fine, y, color=colour, linewidth=1.4, label=r"$\zeta$ = %g" % zeta)
      axes[1].plot(x, response["amplitude"][k], marker, color=colour, markersize=4.6)
      axes[2].plot(x, response["phase"][k], marker, color=colour, markersize=4.6)
  axes[1].set_title("forced: amplitude (7.7)", loc="left", pad=6)
  axes[1].set_ylabel(r"$R\,k\,/\,f_0$")
  axes[1].legend(loc="upper right")
  axes[2].set_title("phase (7.8)", loc="left", pad=6)
  axes[2].set_ylabel(r"$\phi$")
  axes[2].set_yticks((0, math.pi / 2, math.pi), labels=("0", r"$\pi/2$", r"$\pi$"))
  for ax in axes[1:]:
    ax.set_xlabel(r"$\Omega\,/\,\omega^*$")
  for ax in axes:
    Frame(ax)
  Help(figure, "One grain about a pinned one, (\u03b1\u2081, \u03b1\u2082) = (0.5, 0.25). "
       "Lines: the linearized equation (7.10); dots: measured in the flow, for "
       "f\u2080/k = 1e-6; crosses: for f\u2080/k = 0.02, 4 % of r*, where the "
       "well is felt to be soft on its outer side and the resonance bends to lower "
       "frequencies.")
  return figure


@Figure("flow_throughput")
def FlowThroughputFigure(throughput_csv):
  """Of `flow --study`: the cost of one evaluation of the near field."""
  table = ReadTable(throughput_csv, ("particles", "what", "seconds",
                                     "ns_per_ordered_pair", "error"), words=("what",))
  what = table["what"]
  figure, axes = RowOfPanels(2, 11.4, 4.98, top=0.7, wspace=0.22)
  styles = (("plain", "plain loop", GREY, "s"), ("vectorized", "all pairs, vectorized", BLUE, "o"),
            ("tree_1e-2", r"multipoles, bound $10^{-2}$", ORANGE, "v"),
            ("tree_1e-3", r"multipoles, bound $10^{-3}$", GREEN, "^"),
            ("tree_1e-4", r"multipoles, bound $10^{-4}$", PURPLE, "D"),
            ("verlet_step", "a step of Verlet, contacts and all", VERMILION, "x"))
  for name, label, colour, marker in styles:
    k = what == name
    if not k.any():
      continue
    axes[0].plot(table["particles"][k], table["seconds"][k], color=colour, marker=marker,
                 markersize=5.5, label=label)
    if name != "verlet_step":
      axes[1].plot(table["particles"][k], table["ns_per_ordered_pair"][k], color=colour,
                   marker=marker, markersize=5.5)
  axes[0].set_yscale("log")
  axes[0].set_ylabel("CPU time / s")
  figure.legend(loc="upper center", ncol=3, fontsize=11, borderaxespad=0.3)
  axes[1].set_ylabel("ns per ordered pair")
  axes[1].set_yscale("log")
  for ax in axes:
    ax.set_xscale("log")
    ax.set_xlabel("grains  $n$")
    Frame(ax)
  Help(figure, "One evaluation of the attraction and repulsion with exponents 1 and 2 on "
       "one thread. The 1/d attraction has no range beyond which it could be cut off; fast "
       "multipoles keep a bound on the error of every force, relative to the magnitudes of "
       "its pair forces. A step of Verlet has two evaluations where a grain crossed the "
       "boundary: nearly every step of many grains.")
  return figure
