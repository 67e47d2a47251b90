#include "experiments/preparation.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <map>
#include <utility>

#include "experiments/minima.h"
#include "experiments/tabular.h"
#include "granular/atomic_file.h"
#include "granular/packing_io.h"
#include "granular/quad_residual.h"

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// A packing as it is: its contacts, what is measured on it, and its residual.
struct Findings {
  std::vector<Contact> contacts;
  Observables observables;
  double residual = 0.0;  // mean forces, in quadruple precision
  double quad_energy = 0.0;
  double vanishing = 0.0;

  bool Unjammed() const {
    return observables.energy == 0.0 || vanishing <= FLAGS_zero_pressure;
  }
};

Findings Examined(const Packing& packing, const ContactEnergyOptions& law) {
  Findings state;
  QuadResidual judge;
  std::string error;
  const auto energy = ContactEnergy::Create(packing, law, &error);
  if (energy == nullptr ||
      !EvaluateQuad(packing, law, nullptr, &judge, &error)) {
    BadInput(error);
  }
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  double cost = 0.0;
  Scales scales;
  energy->EvaluateWithScales(zero.data(), &cost, nullptr, &scales);
  state.contacts = energy->Contacts(zero.data());
  state.observables = Measure(packing, state.contacts, cost);
  state.residual = judge.Relative();
  state.quad_energy = judge.energy;
  state.vanishing = cost > 0.0 ? scales.vanishing : 0.0;
  return state;
}

// Positions of `a` minus those of `b` in the same cell, nearest images; d N
// entries, grain by grain.
std::vector<double> Difference(const Packing& a, const Packing& b) {
  const int d = a.dimension();
  std::vector<double> result(static_cast<std::size_t>(d) * a.size());
  for (int i = 0; i < a.size(); ++i) {
    SmallVector x(d);
    for (int k = 0; k < d; ++k) {
      const DoubleDouble p = a.Position(i, k), q = b.Position(i, k);
      x[k] = (p.hi - q.hi) + (p.lo - q.lo);
    }
    SmallVector cells = a.box.inverse() * x;
    for (int k = 0; k < d; ++k) cells[k] = std::round(cells[k]);
    x -= a.box.edges() * cells;
    for (int k = 0; k < d; ++k) result[d * i + k] = x[k];
  }
  return result;
}

// How many contacts between rigid grains are made or lost between two states.
// Pairs are counted, whatever their images.
int ContactsChanged(const Findings& before, const Findings& after) {
  std::map<std::pair<int, int>, int> count;
  const auto add = [&count](const Findings& state, int sign) {
    const std::vector<bool>& rattler = state.observables.is_rattler;
    for (const Contact& c : state.contacts) {
      if (!rattler[c.id.i] && !rattler[c.id.j]) {
        count[std::minmax(c.id.i, c.id.j)] += sign;
      }
    }
  };
  add(before, -1);
  add(after, 1);
  int changed = 0;
  for (const auto& [pair, n] : count) changed += std::abs(n);
  return changed;
}

double Attribute(const Packing& packing, const char* key) {
  const auto found = packing.attributes.find(key);
  return found == packing.attributes.end()
             ? std::numeric_limits<double>::quiet_NaN()
             : std::strtod(found->second.c_str(), nullptr);
}

std::string SeedName(std::uint64_t seed) {
  return "seed" + std::to_string(seed);
}

std::string NearJammingName(double distance, std::uint64_t seed) {
  return "near_jamming_" + Neat(distance) +
         (FLAGS_input.empty() ? "_" + SeedName(seed) : "");
}

}  // namespace

Packing Preparation::Relaxed(std::uint64_t seed) {
  if (!FLAGS_input.empty()) {
    if (made_.emplace("input", scene_.packing).second) {
      Note("input", scene_.packing, "");
    }
    return scene_.packing;
  }
  return State("relaxed_" + SeedName(seed), Recipe("relaxed", seed, phi_), [&] {
    return Minimized(MakeScene(phi_, seed).packing, kTolerance);
  });
}

Packing Preparation::Compressed(std::uint64_t seed, double phi) {
  if (!FLAGS_input.empty()) return Relaxed(seed);
  const double first = std::min(kCompressedFrom, phi);
  return State(
      "fig2_" + SeedName(seed),
      Recipe("compressed from " + Neat(first), seed, phi),
      [&] {
        Packing packing = MakeScene(first, seed).packing;
        const int steps = std::max(
            1, static_cast<int>(std::ceil((phi - first) / kStep - 1e-9)));
        for (int step = 0; step <= steps; ++step) {
          stage_ = Format("compression, step %d of %d", step, steps);
          packing.SetPackingFraction(first + (phi - first) * step / steps);
          packing = Minimized(packing, step == steps ? kTolerance : 1e-8);
        }
        return packing;
      });
}

bool Preparation::NearJamming(std::uint64_t seed,
                              const std::vector<double>& distances,
                              std::vector<Packing>* states,
                              std::string* error) {
  std::string what = "near jamming at";
  for (const double d : distances) what += " " + Neat(d);
  const std::string recipe = Recipe(what, seed, phi_);
  const auto name = [&](std::size_t k) {
    return NearJammingName(distances[k], seed);
  };
  states->resize(distances.size());
  std::size_t reused = 0;
  while (reused < distances.size() &&
         Reuse(name(reused), recipe, &(*states)[reused])) {
    ++reused;
  }
  if (reused == distances.size()) return true;
  JammingResult jamming;
  if (!FindPhiJ(seed, 0.1 * distances[0], &jamming, error)) return false;
  Packing packing = jamming.jammed.packing;
  for (std::size_t k = 0; k < distances.size(); ++k) {
    stage_ = "phi_J + " + Neat(distances[k]);
    packing.SetPackingFraction(jamming.phi_j + distances[k]);
    packing = Minimized(packing, kTolerance);
    packing.attributes["phi_j"] = Format("%.17g", jamming.phi_j);
    packing.attributes["prepared"] = recipe;
    if (k >= reused) Keep(name(k), recipe, packing);
    (*states)[k] = packing;
  }
  return true;
}

Packing Preparation::MakeStep(const Packing& before,
                              double strain,
                              std::int64_t max_evaluations,
                              bool* gave_up) {
  *gave_up = false;
  const auto sheared = [&](const Packing& packing, double gamma) {
    Packing start = packing;
    start.Deform(SimpleShear(packing.dimension(), gamma));
    SolveOptions options = Options(kTolerance);
    if (max_evaluations > 0) options.max_evaluations = max_evaluations;
    Relaxation result;
    std::string error;
    if (!Relax(start, scene_.energy, solver_, options, &result, &error)) {
      BadInput(scene_.origin + ": " + error);
    }
    *gave_up = *gave_up || result.summary.reason == StopReason::MAX_EVALUATIONS;
    return Annotated(result, scene_.energy);
  };
  Packing after = sheared(before, strain);
  const Packing halves = sheared(sheared(before, 0.5 * strain), 0.5 * strain);
  const Findings a = Examined(after, scene_.energy);
  const Findings b = Examined(halves, scene_.energy);
  const char* kind = kUndecided;
  double apart = kInfinity;
  if (a.Unjammed() && b.Unjammed()) {
    kind = kUnjammed;
  } else if (a.Unjammed() || b.Unjammed()) {
    if ((a.Unjammed() || a.residual <= kEndBound) &&
        (b.Unjammed() || b.residual <= kEndBound)) {
      kind = kRearranging;
    }
  } else {
    // The translation that two minima may differ by is taken out there.
    const std::vector<double> zero(
        static_cast<std::size_t>(after.dimension()) * after.size(), 0.0);
    apart = RigidDistance(Difference(after, halves),
                          a.observables.is_rattler,
                          zero,
                          b.observables.is_rattler) /
            a.observables.mean_overlap;
    if (a.residual <= kEndBound && b.residual <= kEndBound) {
      kind = apart <= kApartBound ? kNonRearranging : kRearranging;
    }
  }
  after.attributes["step_kind"] = kind;
  after.attributes["step_apart"] = Format("%.17g", apart);
  after.attributes["step_half_energy"] = Format("%.17g", b.observables.energy);
  after.attributes["step_half_residual"] = Format("%.17g", b.residual);
  return after;
}

Packing Preparation::Step(const std::string& name,
                          int k,
                          double strain,
                          const std::string& origin,
                          const Packing& before,
                          std::int64_t max_evaluations,
                          bool* used_again) {
  const std::string file = name + Format("_step_%d", k);
  const std::string recipe =
      Format("step %d of shear %.17g from: ", k, strain) + origin;
  // Part of the recipe where it matters.
  const std::string limited =
      recipe + Format("; at most %lld evaluations",
                      static_cast<long long>(max_evaluations));
  Packing after;
  *used_again = Reuse(file, recipe, &after, /*note=*/false) ||
                Reuse(file, limited, &after, /*note=*/false);
  if (!*used_again) {
    const double began = WallSeconds();
    stage_ = name + Format(", step %d", k);
    if (expected_steps_ > 0) {
      stage_ += Format(" (%d of %d", done_steps_ + 1, expected_steps_);
      if (made_steps_ > 0) {
        stage_ += Format(
            ", %.0f s left at this rate",
            step_seconds_ / made_steps_ * (expected_steps_ - done_steps_));
      }
      stage_ += ")";
    }
    bool gave_up = false;
    after = MakeStep(before, strain, max_evaluations, &gave_up);
    Keep(file, gave_up ? limited : recipe, after, /*note=*/false);
    step_seconds_ += WallSeconds() - began;
    ++made_steps_;
  }
  ++done_steps_;
  return after;
}

std::vector<ShearStep> Preparation::Shear(const Packing& base,
                                          const Case& c,
                                          std::uint64_t seed,
                                          int steps,
                                          std::int64_t max_evaluations) {
  const double strain = StrainOf(c);
  const std::string name = NearJammingName(c.distance, seed) + "_shear_" +
                           Neat(c.value) + (c.relative ? "x" : "");
  std::vector<ShearStep> chain;
  Packing before = base;
  const std::string origin = before.attributes["prepared"];
  Findings state_before = Examined(before, scene_.energy);
  bool all_used_again = true;
  for (int k = 1; k <= steps; ++k) {
    ShearStep step;
    step.start = before;
    step.start.Deform(SimpleShear(before.dimension(), strain));
    bool used_again = false;
    Packing after =
        Step(name, k, strain, origin, before, max_evaluations, &used_again);
    all_used_again = all_used_again && used_again;
    Findings state = Examined(after, scene_.energy);
    const Observables& o = state.observables;
    step.displacements = Difference(after, step.start);
    step.is_rattler = o.is_rattler;
    step.energy = o.energy;
    step.residual = state.residual;
    step.vanishing = state.vanishing;
    step.mean_overlap = o.mean_overlap;
    step.unjammed = state.Unjammed();
    StepRecord& record = step.record;
    record.case_id = c.id;
    record.seed = seed;
    record.step = k;
    record.strain = strain;
    record.kind = after.attributes["step_kind"];
    record.apart = Attribute(after, "step_apart");
    record.contacts = o.rigid_contacts;
    record.contacts_changed = ContactsChanged(state_before, state);
    record.energy = o.energy;
    record.half_energy = Attribute(after, "step_half_energy");
    record.residual = state.residual;
    record.half_residual = Attribute(after, "step_half_residual");
    record.pressure = o.pressure;
    record.minimum = Minima().Tag(o.energy,
                                  state.residual,
                                  state.vanishing,
                                  o.mean_overlap,
                                  step.displacements,
                                  o.is_rattler);
    const bool last = step.unjammed || record.minimum == "-";
    chain.push_back(std::move(step));
    before = std::move(after);
    state_before = std::move(state);
    if (last) {
      done_steps_ += steps - k;  // there is nothing to be made of them
      break;
    }
  }
  NoteChain(name, strain, steps, chain, all_used_again);
  return chain;
}

void Preparation::NoteChain(const std::string& name,
                            double strain,
                            int steps,
                            const std::vector<ShearStep>& chain,
                            bool used_again) {
  std::map<std::string, int> kinds;
  double residual = 0.0;
  for (const ShearStep& step : chain) {
    ++kinds[step.record.kind];
    if (!step.unjammed) residual = std::max(residual, step.residual);
  }
  std::string line = name + ": ";
  for (const auto& [kind, count] : kinds) {
    line += Format("%d %s, ", count, kind.c_str());
  }
  if (residual > 0.0) {
    line += Format("residual <= %.0e mean forces, ", residual);
  }
  line.resize(line.size() - 2);
  if (static_cast<int>(chain.size()) < steps) {
    line += Format(
        ", %s after %zu of %d",
        chain.back().record.minimum == "-" ? "at no minimum" : "unjammed",
        chain.size(),
        steps);
  }
  lines_.push_back(line + (used_again ? " (used again)" : ""));
  Json json = {{"name", name}, {"strain", strain}, {"steps", chain.size()}};
  for (const auto& [kind, count] : kinds) json[kind] = count;
  json["quad_relative_residual"] = residual;
  json_.push_back(json);
}

void Preparation::PrintLines() {
  progress_.Clear();
  const char* head = "prepared";
  for (const std::string& line : lines_) {
    std::printf("%-9s %s\n", head, line.c_str());
    head = "";
  }
}

std::string Preparation::Recipe(const std::string& what,
                                std::uint64_t seed,
                                double phi) const {
  std::string start;
  if (FLAGS_input.empty()) {
    start = Format("%d grains in %dD, seed %llu, phi %.17g",
                   scene_.packing.size(),
                   scene_.packing.dimension(),
                   static_cast<unsigned long long>(seed),
                   phi);
  } else {
    // FNV-1a of the input.
    std::uint64_t hash = 14695981039346656037u;
    for (const char c : FormatPacking(scene_.packing)) {
      hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211u;
    }
    start = Format("input %016llx", static_cast<unsigned long long>(hash));
  }
  std::string recipe = what + Format("; alpha %.17g; ", scene_.energy.alpha) +
                       start + "; " + solver_.name();
  // What else decides about states, where it is not as usual.
  for (const char* flag :
       {"size_ratio", "polydispersity", "precision", "zero_pressure"}) {
    const auto info = gflags::GetCommandLineFlagInfoOrDie(flag);
    if (info.current_value != info.default_value) {
      recipe += "; " + info.name + " " + info.current_value;
    }
  }
  return recipe;
}

Packing Preparation::State(const std::string& name,
                           const std::string& recipe,
                           const std::function<Packing()>& make) {
  const auto known = made_.find(name);
  if (known != made_.end()) return known->second;
  Packing packing;
  if (!Reuse(name, recipe, &packing)) {
    stage_ = name;
    packing = make();
    Keep(name, recipe, packing);
  }
  made_[name] = packing;
  return packing;
}

bool Preparation::Reuse(const std::string& name,
                        const std::string& recipe,
                        Packing* packing,
                        bool note) {
  std::string error;
  Packing read;
  if (!ReadPacking(output_->Path("prepared_" + name + ".xyz"), &read, &error)) {
    return false;
  }
  const auto found = read.attributes.find("prepared");
  if (found == read.attributes.end() || found->second != recipe) return false;
  *packing = std::move(read);
  if (note) Note(name, *packing, " (used again)");
  return true;
}

void Preparation::Keep(const std::string& name,
                       const std::string& recipe,
                       Packing packing,
                       bool note) {
  packing.attributes["prepared"] = recipe;
  std::string error;
  if (!WriteFileAtomically(output_->Path("prepared_" + name + ".xyz"),
                           FormatPacking(packing),
                           &error)) {
    BadInput(error);
  }
  if (note) Note(name, packing, "");
}

void Preparation::Note(const std::string& name,
                       const Packing& packing,
                       const char* remark) {
  const Findings state = Examined(packing, scene_.energy);
  const auto found = packing.attributes.find("phi_j");
  const double phi = packing.PackingFraction();
  std::string line = name + Format(": phi = %.10g, ", phi);
  if (state.Unjammed()) {
    line += Format("unjammed, E = %.3g", state.quad_energy);
  } else {
    line += Format("E = %.3e, residual %.0e mean forces",
                   state.quad_energy,
                   state.residual);
  }
  json_.push_back({{"name", name},
                   {"phi", phi},
                   {"energy", state.quad_energy},
                   {"quad_relative_residual", state.residual}});
  if (found != packing.attributes.end()) {
    const double phi_j = std::strtod(found->second.c_str(), nullptr);
    line += Format(", phi - phi_J = %.3e", phi - phi_j);
    json_.back()["phi_j"] = phi_j;
  }
  lines_.push_back(line + remark);
}

SolveOptions Preparation::Options(double tolerance) {
  SolveOptions options = MakeSolveOptions();
  options.relative_tolerance = tolerance;
  options.callback = [this](const IterationState& state) {
    if (progress_.Due()) {
      progress_.Show(
          Format("preparing %s | iteration %lld: |g| / mean force %.1e",
                 stage_.c_str(),
                 static_cast<long long>(state.counters.iterations),
                 state.scales.gradient > 0.0
                     ? state.max_gradient / state.scales.gradient
                     : 0.0));
    }
    return true;
  };
  return options;
}

Packing Preparation::Minimized(const Packing& start, double tolerance) {
  Relaxation result;
  std::string error;
  if (!Relax(
          start, scene_.energy, solver_, Options(tolerance), &result, &error)) {
    BadInput(scene_.origin + ": " + error);
  }
  return Annotated(result, scene_.energy);
}

bool Preparation::FindPhiJ(std::uint64_t seed,
                           double error_bar,
                           JammingResult* result,
                           std::string* error) {
  const Packing start = Relaxed(seed);
  stage_ = "a jammed state";
  JammingOptions options;
  options.energy = scene_.energy;
  options.solve = Options(1e-8);
  options.solve.vanishing_tolerance = 1e-3 * options.accuracy;
  options.phi_init = 0.0;
  options.error_bar = std::min(error_bar, options.accuracy);
  const auto observer = [this](const JammingStep& step) {
    stage_ = Format("phi_J, %s, phi = %.10f, p = %.1e",
                    JammingStageName(step.stage),
                    step.phi,
                    step.result->observables.pressure);
    return true;
  };
  std::string why;
  bool found = FindJamming(start, options, solver_, observer, result, &why);
  if (found && !result->converged) {
    found = false;
    why = Format(
        "phi_J is known to %.1e only, above %.1e", result->distance, error_bar);
  }
  if (!found) {
    *error =
        (FLAGS_input.empty() ? "seed " + std::to_string(seed) : FLAGS_input) +
        ": " + why;
  }
  return found;
}

}  // namespace granopt
