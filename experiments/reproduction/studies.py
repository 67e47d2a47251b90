"""What is reproduced: each study's command, figures, and the claims it tests.

A new study is one Study() in STUDIES. Its `read` gets the folder of its results and
returns the claims, with our numbers and verdicts, and the tables of the page.
"""

import csv
import json
import math
import os
from dataclasses import dataclass, field


@dataclass
class Claim:
  """What somebody says, what came out, and whether the two agree.

  agrees is None where there is nothing to agree with: a question left open, or a
  figure of ours alone. `because` says why they differ, if that is known.
  """
  text: str
  theirs: str
  ours: str
  agrees: bool = None
  because: str = ""


@dataclass
class Table:
  caption: str
  head: list
  rows: list


@dataclass
class Study:
  key: str  # of its folder
  part: str  # heading on the page
  title: str
  source: str  # in the paper
  command: list
  smoke: list  # what a run of seconds says instead
  read: object  # folder -> ([Claim], [Table])
  figures: list = field(default_factory=list)  # (stem of the file, caption)
  resumes: bool = False
  minutes: float = 1.0  # of a core, about: the long ones start first


def Summary(folder):
  with open(os.path.join(folder, "summary.json"), encoding="utf-8") as file:
    return json.load(file)


def Rows(folder, name):
  with open(os.path.join(folder, name), encoding="utf-8", newline="") as file:
    return list(csv.DictReader(file))


def Number(value, digits=3):
  """Three digits unless said otherwise; a whole number as it is."""
  value = float(value)
  if math.isnan(value):
    return "none"
  if math.isinf(value):
    return "never"
  if value == int(value) and abs(value) < 1e6:
    return "%d" % value
  if 10**digits <= abs(value) < 1e6:
    return "%.0f" % value
  if 1e-3 <= abs(value) < 10**digits:
    return "%.*g" % (digits, value)
  return "%.*e" % (digits - 1, value)


def WithError(value, error):
  """1.234 +- 0.05, to two digits of the error."""
  if not error > 0:
    return Number(value, 4)
  digits = max(0, 1 - math.floor(math.log10(error)))
  return "%.*f ± %.*f" % (digits, value, digits, error)


# ---- energy minimization


def Table1(folder):
  rows = [row for row in Rows(folder, "tables.csv")
          if row["kind"] == "absolute" and float(row["level"]) == 1e-13]
  by = {(row["case"], row["solver"]): row for row in rows}
  cases = list(dict.fromkeys(row["case"] for row in rows))

  def Ratios(one, other, column):
    return [float(by[case, one][column]) / float(by[case, other][column])
            for case in cases]

  def Line(ratios):
    return ", ".join(Number(ratio, 2) for ratio in ratios)

  iterations = Ratios("P-L-BFGS (A = 0)", "L-BFGS", "iterations")
  seconds = Ratios("P-L-BFGS (A = 0)", "L-BFGS", "cpu_seconds")
  a_three = Ratios("P-L-BFGS (A = 0)", "P-L-BFGS (A = 3)", "iterations")
  conjugate = Ratios("P-FR-CG", "FR-CG", "iterations")
  slow = sorted(float(by[case, "L-BFGS"]["cpu_seconds"]) /
                float(by[case, "L-BFGS"]["iterations"]) * 1e3 for case in cases)
  claims = [
      Claim("The preconditioner saves iterations of L-BFGS",
            "0.35, 0.36, 0.63 times as many (cases 1, 2, 3)",
            Line(iterations) + " times", all(r < 1 for r in iterations)),
      Claim("It saves time, too", "0.49, 0.52, 0.80 of the seconds",
            Line(seconds) + " of the CPU seconds", all(r < 1 for r in seconds),
            "an iteration of our L-BFGS takes %s to %s ms, not 12, so the solve with "
            "the preconditioner, which did not get faster, is most of the work"
            % (Number(slow[0], 2), Number(slow[-1], 2))),
      Claim("A = 0 is good enough", "fewer iterations than A = 3",
            Line(a_three) + " times those of A = 3", all(r <= 1 for r in a_three)),
      Claim("It saves iterations of Fletcher-Reeves CG",
            "0.24, 0.28, 0.56 times as many", Line(conjugate) + " times",
            all(r < 1 for r in conjugate),
            "Fletcher-Reeves stalls: preconditioned it does not arrive at all after a "
            "random perturbation (case 3); Hestenes-Stiefel and Polak-Ribiere cure it"),
  ]
  table = Table(
      "Until max|g| ≤ 1e-13, k = 1; medians of the repetitions, the paper's beside",
      ["case", "method", "iterations", "paper", "evaluations", "CPU s", "paper s"],
      [[row["case"], row["solver"], Number(row["iterations"]),
        row["paper_iterations"], Number(row["evaluations"]),
        Number(row["cpu_seconds"]), row["paper_seconds"]] for row in rows])
  return claims, [table]


def Fig2(folder):
  rows = Rows(folder, "tables.csv")
  levels = sorted({float(row["level"]) for row in rows})
  least = levels[0]
  by = {row["solver"]: row for row in rows if float(row["level"]) == least}
  names = list(by)
  counts = {name: float(by[name]["iterations"]) for name in names}
  plain = counts["L-BFGS"]
  preconditioned = min(count for name, count in counts.items()
                       if name.startswith("P-L-BFGS"))
  claims = [Claim(
      "L-BFGS with preconditioner needs the fewest iterations",
      "fewest of the four methods",
      ", ".join("%s %s" % (name, Number(counts[name])) for name in names),
      preconditioned <= min(counts.values()) and preconditioned < plain)]
  return claims, []


def Jamming(folder):
  j = Summary(folder)
  claims = [
      Claim("Bisection finds a jamming point", "φ_cr as the last bracket",
            "φ_J = %s, error bar %s; the bracket ends at %.6f"
            % (Number(j["phi_j"], 6), Number(j["phi_j_error"], 2), j["phi_cr"]),
            None,
            "the bracket is not the error: from the pressure's own slope the state is "
            "%s away from its jamming point" % Number(j["phi_j_error"], 2))]
  return claims, []


def Ensemble(folder):
  j = Summary(folder)
  sizes = j["sizes"]
  isostatic = sum(size["isostatic"] for size in sizes)
  complete = sum(size["complete"] for size in sizes)
  largest = sizes[-1]
  claims = [
      Claim("A packing at its jamming point is isostatic",
            "z₀ = 4 (2 N′ − 1 contacts)",
            "%d of %d packings have exactly 2 N′ − 1" % (isostatic, complete),
            isostatic >= 0.95 * complete),
      Claim("Where a rapid quench jams", "0.8418 (literature, N → ∞; agrees: within 0.002 or 3 standard errors)",
            "%s at N = %d" % (WithError(largest["phi_j"],
                                        1.96 * largest["standard_error"]),
                              largest["particles"]),
            abs(largest["phi_j"] - 0.8418) <=
            max(2e-3, 3 * largest["standard_error"]))]
  table = Table("φ_J of quenched packings",
                ["N", "packings", "mean φ_J", "deviation", "isostatic", "certified"],
                [[size["particles"], size["complete"],
                  WithError(size["phi_j"], size["standard_error"]),
                  Number(size["standard_deviation"], 2), size["isostatic"],
                  size["certified"]] for size in sizes])
  return claims, [table]


LAW_NAMES = {"pressure": "pressure p", "bulk": "bulk modulus B of (12)",
             "shear": "shear modulus G of (13)",
             "shear_mean": "G over all directions", "excess": "z − z₀"}


def Laws(folder):
  exponents = Summary(folder)["exponents"]
  largest = max(e["particles"] for e in exponents)
  claims, rows = [], []
  for e in exponents:
    if e["exponent"] is None:
      continue
    name = LAW_NAMES[e["quantity"]]
    ours = "%.3f (%.3f to %.3f)" % (e["exponent"], e["low"], e["high"])
    rows.append([e["particles"], "%g" % e["alpha"], name, ours,
                 "%g" % e["claim"] if e.get("claim") is not None else "",
                 "%g to %g" % (e["from"], e["to"]), e["packings"],
                 e["not_positive"]])
    if e["particles"] != largest or e.get("claim") is None:
      continue
    inside = e["low"] <= e["claim"] <= e["high"]
    claims.append(Claim(
        "%s ~ Δφ^x, α = %g" % (name, e["alpha"]),
        "%g (%s)" % (e["claim"], e.get("claimed_by", "paper")), ours,
        inside or abs(e["exponent"] - e["claim"]) <= 0.05,
        "the window reaches up to Δφ = %g, where corrections of its order show, and "
        "down to where N = %d is small" % (e["to"], largest)))
  table = Table(
      "Exponents, with 95 % intervals by resampling packings; one agrees if the claim is "
      "inside or within 0.05",
      ["N", "α", "quantity", "exponent", "claim", "fitted from Δφ", "packings",
       "values ≤ 0"], rows)
  return claims, [table]


def StepTable(folder, solvers=None, rearranging="non-rearranging"):
  rows = [row for row in Rows(folder, "step_tables.csv")
          if row["steps_kind"] == rearranging and float(row["level"]) == 1e-7]
  distances = sorted({float(row["distance"]) for row in rows}, reverse=True)
  names = list(dict.fromkeys(row["solver"] for row in rows))
  by = {(row["solver"], float(row["distance"])): row for row in rows}
  return by, names, distances


def Fig7(folder):
  by, names, distances = StepTable(folder)
  far, near = distances[0], distances[-1]

  def Mean(name, distance):
    row = by.get((name, distance))
    return float(row["iterations_mean"]) if row else float("nan")

  plain = (Mean("L-BFGS", far), Mean("L-BFGS", near))
  preconditioned = next(n for n in names if n.startswith("P-L-BFGS"))
  saved = (Mean(preconditioned, far), Mean(preconditioned, near))
  claims = [
      Claim("Iterations of L-BFGS grow towards jamming",
            "from hundreds to 10³-10⁴",
            "%s at Δφ = %.0e, %s at %.0e" % (Number(plain[0]), far, Number(plain[1]), near),
            plain[1] > 2 * plain[0]),
      Claim("The preconditioner needs fewer of them at every distance",
            "fewer throughout",
            "%s and %s" % (Number(saved[0]), Number(saved[1])),
            all(Mean(preconditioned, d) < Mean("L-BFGS", d) for d in distances))]
  table = Table(
      "Mean iterations ± standard deviation of shear steps of 1e-6, until 1e-7 mean "
      "forces (mean CPU ms)", ["method"] + ["%.0e" % d for d in distances],
      [[name] + ["%s ± %s (%s)" % (
          Number(by[name, d]["iterations_mean"]),
          Number(by[name, d]["iterations_deviation"], 2),
          Number(1e3 * float(by[name, d]["seconds_mean"]), 2))
                 if (name, d) in by else "" for d in distances] for name in names])
  return claims, [table]


def Near(folder):
  by, names, distances = StepTable(folder)
  near = [d for d in distances if d <= 1e-3 * 1.0000001]

  def Most(name, column, which):
    return max(float(by[name, d][column]) for d in which if (name, d) in by)

  factors = Most("auto", "factorizations", near)
  failed = int(sum(float(by["auto", d]["failed"]) for d in distances
                   if ("auto", d) in by))
  small = [d for d in distances if d <= 1e-6 * 1.0000001 and ("lbfgs", d) in by]
  gains = [float(by["lbfgs", d]["spent_seconds"]) /
           float(by["auto", d]["spent_seconds"]) for d in small]
  claims = [
      Claim("“Whether one can find a preconditioner which is robust close to the "
            "jamming point” is left open", "open",
            "auto: at most %s factors (median) from Δφ = 1e-3 to %.0e, %d failures"
            % (Number(factors), distances[-1], failed),
            None,
            "answered with a method rather than a preconditioner of L-BFGS: interior "
            "point and Newton on the sparse Hessian, switched by what is observed")]
  if gains:
    claims.append(Claim(
        "What that is worth in time, Δφ ≤ 1e-6", "",
        "%s times less CPU time than L-BFGS (least and most of the medians)"
        % " to ".join(Number(g, 2) for g in (min(gains), max(gains))), None))

  def Cell(row):
    return "%s (%s): %s ms%s" % (
        Number(row["iterations"]), Number(row["factorizations"]),
        Number(1e3 * float(row["spent_seconds"]), 2),
        ", %s failed" % row["failed"] if int(row["failed"]) else "")

  table = Table(
      "Median iterations (factors) and CPU time of shear steps of 0.3 Δφ that do not "
      "rearrange, until 1e-7 mean forces",
      ["method"] + ["%.0e" % d for d in distances],
      [[name] + [Cell(by[name, d]) if (name, d) in by else "" for d in distances]
       for name in names])
  return claims, [table]


def Conditioning(folder):
  j = Summary(folder)
  rows = [row for row in j["condition_numbers"] if row["shear"] == "-"]
  names = list(dict.fromkeys(row["preconditioner"] for row in rows))
  distances = sorted({row["distance"] for row in rows}, reverse=True)
  by = {(row["preconditioner"], row["distance"]): row["median"] for row in rows}
  table = Table("Condition numbers of the (preconditioned) Hessian, medians",
                ["preconditioner"] + ["%.0e" % d for d in distances],
                [[name] + [Number(by[name, d], 2) if by.get((name, d)) else ""
                           for d in distances] for name in names])
  return [], [table]


def Fig8(folder):
  j = Summary(folder)
  small = max(a["small_strain"] for a in j["agreement"])
  everywhere = max(a["all"] for a in j["agreement"])
  claims = [
      Claim("Curves of different increments are one at small strain", "one curve (agrees: within 2 %)",
            "stress within %s of its largest value over the first tenth"
            % Number(small, 2), small < 0.02,
            "a packing may rearrange in its first steps, and an increment decides how"),
      Claim("and alike over all of it", "qualitatively (agrees: within 30 %)",
            "%s apart in the mean; they part at %s of strain"
            % (Number(everywhere, 2),
               " and ".join(Number(a["agrees_until"], 2) for a in j["agreement"])),
            everywhere < 0.3)]
  return claims, []


def Yield(folder):
  j = Summary(folder)
  if not j["yields"]:
    return [Claim("Shear by stress", "", "holds %s" % Number(j["asked"]))], []
  pressure = j["pressure"]
  return [Claim(
      "How much shear stress a frictionless packing bears", "",
      "yields at %s of its pressure, between %s and %s"
      % (Number(j["reached"] / pressure, 3), Number(j["reached"], 4),
         Number(j["refused"], 4)), None,
      "above, no state was found: " + j["why"])], []


# ---- near-field flow


def FlowPaper(folder):
  j = Summary(folder)
  cases = j["strengths"]
  fractions = [case["relative_fraction1"] for case in cases]
  image = j["variants"]["nearest_image"]
  grows = all(a < b for a, b in zip(fractions, fractions[1:]))
  claims = [
      Claim("Stronger near fields, more relative motion (Figs 5, 6)",
            "grows with the strength, most of the energy for the strongest",
            ", ".join("%.3f" % f for f in fractions) + " of T at t = 1",
            grows and fractions[-1] > 0.5),
      Claim("It is the near field that does this", "attributed to the near field",
            "of the growth in case 4, %.2f J/kg come in where grains jump from x to −x; "
            "with nearest images the part is %s"
            % (cases[-1]["boundary"],
               ", ".join("%.2f" % case["relative_fraction1"] for case in image)),
            image[-1]["relative_fraction1"] > 0.5,
            "the paper's boundary rule changes the potential energy at every jump")]
  rows = []
  for name, list_ in [("paper", cases)] + [
      (key.replace("_", " "), value) for key, value in j["variants"].items()]:
    for case in list_:
      rows.append([name, "%g, %g" % (case["alpha1"], case["alpha2"]),
                   "%.3f ± %.3f" % (case["T1"], case["T1_sd"]),
                   "%.3f ± %.3f" % (case["relative_fraction1"],
                                    case["relative_fraction1_sd"]),
                   "%.3f" % case["boundary"], "%.3f" % case["impact"],
                   "%.3f" % case["friction"], "%.3f" % case["numerical"],
                   Number(case["force_sweeps"])])
  table = Table(
      "T and its relative part at t = 1 (mean ± standard deviation over %d starts); "
      "what boundary, impacts, friction and the integrator put in, J/kg" % j["seeds"],
      ["reading", "strengths", "T(1)", "relative part", "boundary", "impact",
       "friction", "numerical", "sweeps"], rows)
  return claims, [table]


def Oscillator(folder):
  j = Summary(folder)
  finest = {}
  for row in j["ratios"]:
    key = (row["stepper"], row["pinned"])
    if key not in finest or row["dt"] < finest[key]["dt"]:
      finest[key] = row
  worst = max(abs(row["ratio"] - 1) for row in finest.values())
  return [
      Claim("Two grains oscillate at ω* of (7.13)", "ω*",
            "ratio 1 within %s at the finest steps" % Number(worst, 2), worst < 1e-3),
      Claim("and resonate as the linear oscillator of (7.5)-(7.8)", "linear response",
            "amplitudes within %s" % Number(j["worst_amplitude_error"], 2),
            j["worst_amplitude_error"] < 1e-2)], []


def Remark8(folder):
  rows = Summary(folder)["rows"]
  names = list(dict.fromkeys(row["method"] for row in rows))
  steps = sorted({row["dt"] for row in rows})
  by = {(row["method"], row["dt"]): row for row in rows}
  jacobi = max([d for d in steps
                if by["jacobi", d]["solved"] == by["jacobi", d]["attempts"]] or [0])
  lbfgs = max([d for d in steps
               if by["lbfgs", d]["solved"] == by["lbfgs", d]["attempts"]] or [0])
  claims = [Claim(
      "Gradients may solve a step where fixed points do not (Remark 8)", "suggested",
      "the fixed point solves every step up to Δt = %g, L-BFGS up to %g"
      % (jacobi, lbfgs), lbfgs > jacobi)]
  table = Table("Steps solved, and median force evaluations",
                ["method"] + ["Δt = %g" % d for d in steps],
                [[name] + ["%d of %d; %s" % (
                    by[name, d]["solved"], by[name, d]["attempts"],
                    Number(by[name, d]["median_sweeps"]))
                           if (name, d) in by else "" for d in steps]
                 for name in names])
  return claims, [table]


def Throughput(folder):
  rows = Summary(folder)["rows"]
  names = list(dict.fromkeys(row["what"] for row in rows))
  sizes = sorted({row["particles"] for row in rows})
  by = {(row["what"], row["particles"]): row for row in rows}
  best = min(row["ns_per_ordered_pair"] for row in rows
             if row["what"] == "vectorized")
  claims = [Claim("What an ordered pair costs, exponents (1, 2)",
                  "", "%s ns" % Number(best, 2))]
  table = Table("Seconds a sweep", ["sweep"] + ["n = %d" % n for n in sizes],
                [[name.replace("_", " ")] + [
                    Number(by[name, n]["seconds"]) if (name, n) in by else ""
                    for n in sizes] for name in names])
  return claims, [table]


def Identify(folder):
  j = Summary(folder)
  claims = [
      Claim("Strings and runs of the search (sec. 8.2)",
            "310 and 1757 (agrees: the same, within 5 %)",
            "%d and %d" % (j["strings"], j["runs"]),
            j["strings"] == 310 and abs(j["runs"] - 1757) <= 0.05 * 1757),
      Claim("The best misfit P found", "0.0652 (its own starts)",
            "reported %s; on %d fresh starts %s"
            % (Number(j["reported"]), j["best"]["starts"],
               WithError(j["best"]["fresh"], 1.96 * j["best"]["fresh_error"])),
            abs(j["best"]["fresh"] - 0.0652) <=
            3 * max(j["best"]["fresh_error"], 0.0022))]
  rows = []
  for candidate in j.get("candidates", []):
    string = candidate.get("string", {})
    rows.append([candidate.get("origin", candidate.get("name", ""))] + [
        Number(value) for value in string.values()] + [
            WithError(candidate["fresh"], 1.96 * candidate["fresh_error"])])
  tables = []
  if rows:
    names = list(j["candidates"][0].get("string", {}))
    tables.append(Table("On the same fresh starts (± 95 %)",
                        ["string"] + names + ["P"], rows))
  if len(j.get("axes", [])) > 0:
    claims.append(Claim(
        "The parameters are identified", "six strings, ranked",
        "%d of the strings tried again are not told from the best; %s"
        % (j["equal_strings"],
           "; ".join("%s from %s to %s" % (name, Number(j["equal_low"][name]),
                                           Number(j["equal_high"][name]))
                     for name in j["equal_low"])), False,
        "P is noise of its starts to ± 0.005, and only a combination of the "
        "parameters matters"))
  return claims, tables


# ---- the trade


def Tradeoff(folder):
  rows = Summary(folder)["recommendations"]
  return [], [Table(
      "For this accuracy use this: the cheapest settings that reached it",
      ["scene", "what is wanted", "relative error", "flags", "CPU s"],
      [[row["scene"], row["observable"].replace("_", " "),
        "%g" % row["accuracy"], row["flags"], Number(row["cpu_seconds"])]
       for row in rows])]


def TradeoffFlow(folder):
  j = Summary(folder)
  rows = [row for row in j["recommendations"]
          if row["cheapest_by"] == "cpu_seconds"]
  what = {scene["scene"]: scene["what"] for scene in j["scenes"]}
  return [], [Table(
      "For this accuracy use this: the cheapest settings that reached it",
      ["scene", "what is wanted", "error", "flags", "sweeps", "CPU ms"],
      [[what[row["scene"]], row["observable"].replace("_", " "),
        "%g" % row["accuracy"], row["flags"], Number(row["sweeps"]),
        Number(1e3 * row["cpu_seconds"])] for row in rows])]


def Extremes(folder):
  j = Summary(folder)
  cells = j["cells"]
  claims = [Claim(
      "What became of all cells (wrong: claimed and not so; lost: no end)", "",
      ", ".join("%d %s" % (count, name) for name, count in cells.items()))]
  names = list(dict.fromkeys(row["solver"] for row in j["results"]))
  rows = []
  for name in names:
    mine = [row["cell"] for row in j["results"] if row["solver"] == name]
    rows.append([name] + [mine.count(cell) for cell in cells])
  return claims, [Table("Extremes by method", ["method"] + list(cells), rows)]


def Fidelity(folder):
  j = Summary(folder)
  models = j["models"]
  quantities = [key for key, value in models[0].items() if isinstance(value, dict)]
  cost = next(key for key in models[0] if key.startswith("cpu_seconds"))
  rows = []
  for model in models:
    row = [model["model"], Number(model[cost])]
    for q in quantities:
      cell = model[q]
      row.append("%s (%s)" % (
          WithError(cell["difference"], cell["difference_error"]),
          {"no": "matters"}.get(cell["verdict"], cell["verdict"])))
    rows.append(row)
  claims = []
  if "recommended" in j:
    claims.append(Claim("The cheapest model within %g" % j["accuracy"], "",
                        j["recommended"], None))
  return claims, [Table("Change of each quantity against the whole model",
                        ["model", "CPU s"] + [q.replace("_", " ") for q in quantities],
                        rows)]


PACKINGS = "Energy minimization of granular packings (Wang & Zhang)"
FLOWS = "Near-field granular flow (Zohdi)"
TRADE = "Speed, accuracy, extremes"

STUDIES = [
    Study("fig2", PACKINGS, "One minimization", "Fig. 2",
          ["compare", "--paper=fig2"], ["--smoke"], Fig2,
          [("curves", "Residual against iterations and CPU time")], True, 2),
    Study("table1", PACKINGS, "Three small loads", "Table 1",
          ["compare", "--paper=table1"], ["--smoke"], Table1,
          [("curves", "Residual against iterations and CPU time")], True, 3),
    Study("fig3", PACKINGS, "From loose to jammed", "Fig. 3, Algorithm 1",
          ["jamming", "--paper", "--particles=1024"], ["--smoke", "--particles=64"],
          Jamming, [("stages", "Start, last unjammed and first jammed state"),
                    ("path", "The search")], True, 1),
    Study("jamming", PACKINGS, "The jamming point, sharply", "beyond sec. 4.1",
          ["jamming", "--seeds=1-10", "--sizes=64,128,256,512,1024",
           "--polydispersity=1e-3"], ["--seeds=1-4", "--sizes=64,128"], Ensemble,
          [("ensemble", "φ_J of packings of each size"),
           ("finite_size", "Mean φ_J against the number of grains")], True, 3),
    Study("scaling", PACKINGS, "Scaling laws and moduli", "Figs 4, 5, 6",
          ["scaling", "--paper"], ["--smoke"], Laws,
          [("laws", "Pressure, moduli and contacts against Δφ; lines: the claims"),
           ("collapse", "All sizes against P N²"),
           ("vibrations", "Density of vibrational states")], True, 60),
    Study("fig7", PACKINGS, "Cost towards jamming", "Fig. 7",
          ["compare", "--paper=fig7", "--particles=1024"],
          ["--smoke", "--particles=64"], Fig7,
          [("fig7", "Mean and deviation over steps and packings")], True, 30),
    Study("near_jamming", PACKINGS, "The open question", "sec. 5",
          ["compare", "--cases=near_jamming=0.3x", "--particles=1024", "--seeds=1-3",
           "--steps=10", "--tolerance=1e-7", "--repetitions=1",
           "--max_evaluations=60000",
           "--solvers=lbfgs;auto;newton;interior_point;"
           "barrier@lbfgs:preconditioner=barrier,shift=1e-6"],
          ["--particles=64", "--seeds=1", "--steps=2"], Near,
          [("distances_non_rearranging", "Cost of shear steps against Δφ")], True, 15),
    Study("conditioning", PACKINGS, "Conditioning or contact change?", "beyond sec. 3",
          ["conditioning", "--particles=1024", "--seeds=1-3"],
          ["--smoke", "--particles=64", "--seeds=1"], Conditioning,
          [("conditioning", "Condition numbers and contact changes")], False, 5),
    Study("fig8", PACKINGS, "Pure shear", "Fig. 8", ["shear", "--paper"], ["--smoke"],
          Fig8, [("curves", "Stress and fabric against strain, three increments")],
          True, 3),
    Study("yield", PACKINGS, "Shear by a given stress", "beyond sec. 4.3",
          ["shear", "--mode=stress", "--pressure=1e-3", "--shear_stress=5e-4",
           "--particles=256"], ["--particles=64", "--stress_steps=4"], Yield,
          [("stress", "Strain, volume and contacts against shear stress")], True, 1),
    Study("flow", FLOWS, "Charged grains that collide and rub", "Figs 4, 5, 6",
          ["flow", "--paper"], ["--smoke"], FlowPaper,
          [("start", "The start (Fig. 4)"),
           ("fractions", "Bulk and relative part of the energy (Fig. 5)"),
           ("energy", "Energy per mass (Fig. 6)"),
           ("boundary", "What jumps at the boundary put in")], False, 1),
    Study("oscillator", FLOWS, "Two grains: frequency and resonance",
          "sec. 7.2, (7.5)-(7.13)", ["flow", "--study=oscillator"], ["--smoke"],
          Oscillator, [("oscillator", "Decay and resonance")], False, 1),
    Study("remark8", FLOWS, "Gradients for the implicit step", "Remark 8",
          ["flow", "--study=remark8"], ["--smoke"], Remark8,
          [("remark8", "Steps solved against their length")], False, 2),
    Study("identification", FLOWS, "Which near field behaves as asked?",
          "sec. 8, Fig. 7, Table 1, Fig. 8", ["identify", "--paper"], ["--smoke"],
          Identify, [("convergence", "Misfit of the generations (Fig. 7)"),
                     ("response", "Energies with the best string (Fig. 8)"),
                     ("valley", "Strings that are equally good"),
                     ("profile", "The least misfit with one parameter held")],
          True, 20),
    Study("work_precision", FLOWS, "Steppers: work and precision", "beyond sec. 6",
          ["flow", "--study=work_precision"], ["--smoke"], lambda folder: ([], []),
          [("work_precision", "Error against force sweeps")], False, 3),
    Study("throughput", FLOWS, "Throughput", "beyond sec. 6",
          ["flow", "--study=throughput"], ["--smoke"], Throughput,
          [("throughput", "Seconds a sweep against the number of grains")], False, 3),
    Study("tradeoff", TRADE, "What accuracy costs", "packings",
          ["tradeoff", "--seeds=1-2"], ["--smoke"], Tradeoff,
          [("tradeoff", "Error of what is wanted against CPU time"),
           ("phi_j", "What sharper jamming points cost")], False, 15),
    Study("tradeoff_flow", TRADE, "What accuracy costs in a flow", "flows",
          ["tradeoff", "--flow", "--repetitions=2"], ["--smoke"], TradeoffFlow,
          [("tradeoff_flow", "Error of what is wanted against CPU time")], True, 12),
    Study("extremes", TRADE, "Extremes of packings", "every method",
          ["extremes"], ["--smoke"], Extremes,
          [("extremes", "What became of every method")], True, 20),
    Study("extreme_flows", TRADE, "Extremes of flows", "every stepper",
          ["extremes", "--flow"], ["--smoke"], Extremes,
          [("extremes", "What became of every stepper")], True, 3),
    Study("sand", TRADE, "What a sand-like scene requires", "models of a flow",
          ["fidelity", "--scene=sand"], ["--smoke"], Fidelity,
          [("fidelity", "Cost and change of each ingredient")], False, 2),
    Study("powder", TRADE, "What a charged powder requires", "models of a flow",
          ["fidelity", "--scene=powder"], ["--smoke"], Fidelity,
          [("fidelity", "Cost and change of each ingredient")], False, 2),
    Study("packing", TRADE, "What a packing requires", "models of a packing",
          ["fidelity", "--scene=packing", "--seeds=10", "--particles=512"],
          ["--smoke", "--seeds=3", "--particles=128"], Fidelity,
          [("fidelity", "Cost and change of each ingredient")], False, 2),
]
