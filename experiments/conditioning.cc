// conditioning: is it the condition number of the Hessian that makes
// relaxations near jamming long, or is it that contacts open and close?
//
//   conditioning --distances=1e-2,1e-3,... --shear=1e-6,0.3x
//                --preconditioners="none;contact;label@contact:shift=1e-8"
//                --input=F.xyz | --particles=N --phi=P --seeds=1-3 --alpha=2
//                --prepare_solver=lbfgs --out=DIR
//   conditioning --replot=DIR
//
// For states at the distances from jamming, made as `compare
// --cases=near_jamming` makes them (its prepared_*.xyz are used again):
// conditioning.csv has the extreme eigenvalues of P^-1 H for each
// preconditioner, made there ("fresh") and, for each shear step, made before
// the step with H from after it ("lagged"); contact_changes.csv which contacts
// the step and Newton's first step change. Tables and the figure are made from
// these two alone.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "experiments/cases.h"
#include "experiments/comparison_setup.h"
#include "experiments/conditioning_measure.h"
#include "experiments/conditioning_records.h"
#include "experiments/conditioning_tables.h"
#include "experiments/preparation.h"
#include "experiments/replot.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"
#include "granular/atomic_file.h"
#include "solvers/preconditioner.h"

DEFINE_string(preconditioners,
              "none;laplacian;contact;"
              "contact, shift 1e-8@contact:shift=1e-8;"
              "barrier 0.1, shift 1e-8@barrier:length=0.1,shift=1e-8;"
              "barrier 1, shift 1e-8@barrier:length=1,shift=1e-8;"
              "hessian, shift 1e-8@hessian:shift=1e-8",
              "P, separated by semicolons, each as name:key=value,... or "
              "label@name:key=value,... (see --list_solvers); none: kappa 1");
DEFINE_double(phi, 0.8438, "packing fraction of generated packings");
DEFINE_string(seeds, "1-3", "seeds as in 1-3 or 1,4,7");
DEFINE_string(distances,
              "1e-2,1e-3,1e-4,1e-5,1e-6,1e-7,1e-8",
              "distances phi - phi_J");
DEFINE_string(shear,
              "1e-6,0.3x",
              "shear steps, separated by commas: a strain, or as in 0.3x a "
              "multiple of the distance");
DEFINE_string(prepare_solver,
              granopt::kDefaultSolver,
              "the method that relaxes the states");
DEFINE_int64(prepare_evaluations,
             1000000,
             "a relaxation after a step gives up after this many evaluations "
             "(0: never)");
DEFINE_string(replot,
              "",
              "folder of an earlier run: make its tables and figure again");

namespace granopt {
namespace {

std::vector<std::string> Figures() {
  return {"conditioning.svg", "conditioning.png"};
}

struct Plan {
  Scene scene;
  std::unique_ptr<Solver> prepare;
  std::vector<Method> preconditioners;
  std::vector<std::uint64_t> seeds;
  std::vector<double> distances;  // increasing
  std::vector<Case> shears;       // near_jamming, at the least distance
};

// A shear as the user wrote it: "1e-6", "0.3x".
std::string ShearName(const Case& shear) {
  return Neat(shear.value) + (shear.relative ? "x" : "");
}

// A seed and a distance: all preconditioners, all shears.
void MeasureState(const Plan& plan,
                  std::uint64_t seed,
                  double distance,
                  const Packing& base,
                  Preparation* preparation,
                  Progress* progress,
                  const std::string& where,
                  ConditioningRows* rows) {
  const ContactEnergyOptions& law = plan.scene.energy;
  const State before = Examine(base, law);
  const auto show = [&](const std::string& what) {
    if (progress->Due()) progress->Show(where + ": " + what);
  };
  const auto add =
      [&](const Method& method, const std::string& shear, ConditionRow row) {
        row.seed = seed;
        row.distance = distance;
        row.label = method.label;
        row.spec = method.spec;
        row.shear = shear;
        rows->conditions.push_back(std::move(row));
      };
  SparseMatrix h = HessianAt(before);
  std::map<std::string, SparseMatrix> made;  // by label
  for (const Method& method : plan.preconditioners) {
    show(method.label);
    ConditionRow row;
    SparseMatrix p;
    if (MakeP(method.spec, before, &p, &row.message)) {
      row = Measured(h, before, p);
      made[method.label] = std::move(p);
    }
    add(method, "-", row);
  }
  for (Case shear : plan.shears) {
    shear.distance = distance;
    const double strain = StrainOf(shear);
    const std::string name = ShearName(shear);
    progress->Clear();
    const ShearStep step = std::move(
        preparation->Shear(base, shear, seed, 1, FLAGS_prepare_evaluations)[0]);
    preparation->ClearProgress();
    const State deformed = Examine(step.start, law);
    const bool at_minimum =
        step.record.minimum != "-" && step.vanishing > FLAGS_zero_pressure;
    std::unique_ptr<State> after;
    if (at_minimum) {
      after = std::make_unique<State>(Examine(
          deformed.energy->Configuration(step.displacements.data()), law));
    }
    ChangeRow change = MeasuredChange(before, deformed, after.get(), strain);
    change.seed = seed;
    change.distance = distance;
    change.shear = name;
    change.strain = strain;
    change.kind = step.record.kind;
    rows->changes.push_back(change);
    if (after != nullptr) h = HessianAt(*after);
    for (const Method& method : plan.preconditioners) {
      show(method.label + ", lagged by a shear of " + name);
      ConditionRow row;
      row.number = std::numeric_limits<double>::quiet_NaN();
      if (after == nullptr) {
        row.message = "the step did not end at a jammed minimum";
      } else if (made.count(method.label) == 0) {
        row.message = "no P";
      } else {
        row = Measured(h, *after, made.at(method.label));
      }
      add(method, name, row);
    }
  }
}

Plan MakePlan() {
  Plan plan;
  std::string error;
  if (!FLAGS_input.empty() && IsGiven("phi")) {
    BadInput("--phi describes a random start and cannot go with --input");
  }
  CheckPositive("phi", FLAGS_phi);
  CheckRange("prepare_evaluations", FLAGS_prepare_evaluations, 0.0, 9e18);
  if (FLAGS_smoke) {
    if (!IsGiven("particles") && FLAGS_input.empty()) FLAGS_particles = 64;
    if (!IsGiven("distances")) FLAGS_distances = "1e-2,1e-3,1e-4";
    if (!IsGiven("seeds")) FLAGS_seeds = "1";
  }
  Require(ParseMethods(FLAGS_preconditioners, &plan.preconditioners, &error),
          "preconditioners",
          error);
  for (const Method& method : plan.preconditioners) {
    if (method.spec == kNone) continue;
    const bool made = CreatePreconditioner(method.spec, &error) != nullptr;
    Require(made, "preconditioners", error);
  }
  plan.prepare = MakeSolver("prepare_solver", FLAGS_prepare_solver);
  Require(ParseDistances(FLAGS_distances, &plan.distances, &error),
          "distances",
          error);
  std::sort(plan.distances.begin(), plan.distances.end());
  // The same words as in the cases of `compare`.
  std::string cases;
  std::istringstream items(FLAGS_shear);
  for (std::string item; std::getline(items, item, ',');) {
    cases += (cases.empty() ? "" : ",") + std::string("near_jamming=") + item;
  }
  std::vector<Case> parsed;
  if (cases.empty()) BadInput("--shear= is empty");
  Require(
      ParseCases(cases, plan.distances, 0.0, &parsed, &error), "shear", error);
  for (const Case& c : parsed) {
    if (c.distance == plan.distances[0]) plan.shears.push_back(c);
  }
  plan.seeds = {FLAGS_seed};
  // --seed, if it alone is given.
  if (IsGiven("seeds") || !IsGiven("seed")) {
    Require(ParseSeeds(FLAGS_seeds, &plan.seeds, &error), "seeds", error);
  }
  // With an input no random number is drawn.
  if (!FLAGS_input.empty()) plan.seeds.resize(1);
  plan.scene = MakeScene(FLAGS_phi, plan.seeds[0]);
  const auto energy =
      ContactEnergy::Create(plan.scene.packing, plan.scene.energy, &error);
  for (const Method& method : plan.preconditioners) {
    if (method.spec == kNone) continue;
    const bool served =
        CreatePreconditioner(method.spec, &error)->Supports(*energy, &error);
    Require(served, "preconditioners", error);
  }
  return plan;
}

Json NumberOrNull(double value) {
  return std::isfinite(value) ? Json(value) : Json();
}

Json SummaryJson(const Plan& plan,
                 const Preparation& preparation,
                 const ConditioningRows& rows) {
  Json json;
  std::size_t found = 0;
  for (const ConditionRow& r : rows.conditions) {
    found += r.found ? 1 : 0;
  }
  json["spectra"] = rows.conditions.size();
  json["spectra_found"] = found;
  json["alpha"] = plan.scene.energy.alpha;
  json["k"] = plan.scene.energy.stiffness;
  json["dimension"] = plan.scene.packing.dimension();
  json["particles"] = plan.scene.packing.size();
  json["prepare_solver"] = plan.prepare->name();
  json["prepared"] = preparation.json();
  json["preconditioners"] = MethodsJson(plan.preconditioners);
  json["condition_numbers"] = Json::array();
  std::set<std::string> shears = {"-"};
  for (const Case& shear : plan.shears) shears.insert(ShearName(shear));
  for (const std::string& shear : shears) {
    for (const Method& method : plan.preconditioners) {
      for (const double distance : plan.distances) {
        std::vector<double> numbers;
        for (const ConditionRow& r : rows.conditions) {
          if (r.shear == shear && r.label == method.label &&
              r.distance == distance && r.found) {
            numbers.push_back(r.number);
          }
        }
        if (numbers.empty()) continue;
        const MedianWorst value = MedianAndWorst(numbers);
        json["condition_numbers"].push_back(
            {{"shear", shear},
             {"preconditioner", method.label},
             {"distance", distance},
             {"packings", numbers.size()},
             {"median", NumberOrNull(value.median)},
             {"worst", NumberOrNull(value.worst)}});
      }
    }
  }
  json["schema"] = "granopt/conditioning/1";
  json["provenance"] = Provenance();
  return json;
}

// The figure, from the files of `data`.
void Draw(const std::string& data, Output* output) {
  output->Plot({"conditioning",
                data + "/conditioning.csv",
                data + "/contact_changes.csv",
                output->Path("conditioning")},
               Figures());
}

void PrintReadingHelp() {
  std::printf(
      "\nHow to read it: where (1) stays flat as phi - phi_J -> 0, the "
      "condition number of that P is no obstacle, and a P whose (1) is flat "
      "but whose (3) rises\n"
      "is only as good as the contacts that it was made from. In (2), many "
      "changes within one Newton step mean that a quadratic model, however "
      "well preconditioned,\n"
      "says little about the way ahead.\n");
}

// Of an earlier run; BadInput if there is nothing in it.
template <typename Row>
void Read(const std::string& path, std::vector<Row>* rows) {
  std::string text, error;
  Require(ReadFile(path, &text, &error), "replot", error);
  Require(ParseCsv(text, path, rows, &error), "replot", error);
  Require(!rows->empty(), "replot", path + " has no rows");
}

void Report(const ConditioningRows& rows,
            const std::string& data,
            Output* output) {
  const std::string text = TablesText(rows);
  output->Write("tables.txt", text);
  std::fputs(text.c_str(), stdout);
  Draw(data, output);
  PrintReadingHelp();
}

int Replot() {
  const std::string data = FolderToReplot(FLAGS_replot);
  RefuseOthersWithReplot({});
  ConditioningRows rows;
  Read(data + "/conditioning.csv", &rows.conditions);
  Read(data + "/contact_changes.csv", &rows.changes);
  std::vector<std::string> names = Figures();
  names.push_back("tables.txt");
  Output output;
  output.Create(IsGiven("out") ? FLAGS_out : data, names);
  std::printf("conditioning  tables and figure of %s again\n", data.c_str());
  Report(rows, data, &output);
  output.PrintFiles();
  return kConverged;
}

int Main() {
  ListSolversIfAsked();
  if (IsGiven("replot")) return Replot();
  const Plan plan = MakePlan();
  std::vector<std::string> names = Figures();
  for (const char* name : {"conditioning.csv",
                           "contact_changes.csv",
                           "tables.txt",
                           "summary.json"}) {
    names.push_back(name);
  }
  Output output;
  output.Create(FLAGS_out, names);
  std::printf("conditioning  %s, alpha = %g, %zu distances, %zu packing%s\n",
              Describe(plan.scene.packing).c_str(),
              plan.scene.energy.alpha,
              plan.distances.size(),
              plan.seeds.size(),
              plan.seeds.size() == 1 ? "" : "s");
  const char* head = "P";
  for (const Method& method : plan.preconditioners) {
    std::printf(
        "%-13s %s%s\n",
        head,
        method.label.c_str(),
        method.label == method.spec ? "" : ("  = " + method.spec).c_str());
    head = "";
  }
  std::fflush(stdout);

  Preparation preparation(plan.scene, *plan.prepare, FLAGS_phi, &output);
  preparation.ExpectSteps(static_cast<int>(
      plan.seeds.size() * plan.distances.size() * plan.shears.size()));
  ConditioningRows rows;
  std::size_t done = 0;
  const std::size_t all = plan.seeds.size() * plan.distances.size();
  for (const std::uint64_t seed : plan.seeds) {
    std::vector<Packing> states;
    std::string error;
    if (!preparation.NearJamming(seed, plan.distances, &states, &error)) {
      preparation.ClearProgress();
      std::fprintf(stderr, "conditioning: %s\n", error.c_str());
      return kNotConverged;
    }
    preparation.ClearProgress();
    Progress progress;
    // From far to near, as one reads.
    for (std::size_t k = plan.distances.size(); k-- > 0;) {
      const std::string where = Format("state %zu of %zu (seed %llu, phi_J + ",
                                       ++done,
                                       all,
                                       static_cast<unsigned long long>(seed)) +
                                Neat(plan.distances[k]) + ")";
      MeasureState(plan,
                   seed,
                   plan.distances[k],
                   states[k],
                   &preparation,
                   &progress,
                   where,
                   &rows);
    }
  }
  output.Write("conditioning.csv", FormatCsv(rows.conditions));
  output.Write("contact_changes.csv", FormatCsv(rows.changes));
  Report(rows, output.folder(), &output);
  bool converged = true;
  for (const ConditionRow& r : rows.conditions) {
    if (r.found) continue;
    converged = converged && r.shear != "-";
    std::printf("\nnot found: seed %llu at %s, %s, shear %s: %s",
                static_cast<unsigned long long>(r.seed),
                Neat(r.distance).c_str(),
                r.label.c_str(),
                r.shear.c_str(),
                r.message.c_str());
  }
  output.WriteJson("summary.json", SummaryJson(plan, preparation, rows));
  output.PrintFiles();
  return converged ? kConverged : kNotConverged;
}

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  granopt::ParseFlags(
      &argc,
      &argv,
      "is it conditioning or contact change that makes "
      "relaxations near jamming long? eigenvalues of P^-1 H and "
      "contacts made and lost against the distance to jamming");
  return granopt::Main();
}
