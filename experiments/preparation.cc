#include "experiments/preparation.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "experiments/comparison.h"
#include "granular/atomic_file.h"
#include "granular/packing_io.h"
#include "granular/quad_residual.h"

namespace granopt {

Packing Preparation::Relaxed(std::uint64_t seed) {
  if (!FLAGS_input.empty()) {
    if (made_.emplace("input", scene_.packing).second) {
      Note("input", scene_.packing, "");
    }
    return scene_.packing;
  }
  return State(
      Format("relaxed_seed%llu", static_cast<unsigned long long>(seed)),
      Recipe("relaxed", seed, phi_),
      [&] {
        return Minimized(MakeScene(phi_, seed).packing, kTolerance, nullptr);
      });
}

Packing Preparation::Compressed(std::uint64_t seed, double phi) {
  if (!FLAGS_input.empty()) return Relaxed(seed);
  const double first = std::min(kCompressedFrom, phi);
  return State(
      Format("fig2_seed%llu", static_cast<unsigned long long>(seed)),
      Recipe("compressed from " + Neat(first), seed, phi),
      [&] {
        Packing packing = MakeScene(first, seed).packing;
        const int steps = std::max(
            1, static_cast<int>(std::ceil((phi - first) / kStep - 1e-9)));
        for (int step = 0; step <= steps; ++step) {
          stage_ = Format("compression, step %d of %d", step, steps);
          packing.SetPackingFraction(first + (phi - first) * step / steps);
          packing =
              Minimized(packing, step == steps ? kTolerance : 1e-8, nullptr);
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
    return "near_jamming_" + Neat(distances[k]) +
           (FLAGS_input.empty()
                ? Format("_seed%llu", static_cast<unsigned long long>(seed))
                : "");
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
    packing = Minimized(packing, kTolerance, nullptr);
    packing.attributes["phi_j"] = Format("%.17g", jamming.phi_j);
    if (k >= reused) Keep(name(k), recipe, packing);
    (*states)[k] = packing;
  }
  return true;
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
  return what + Format("; alpha %.17g; ", scene_.energy.alpha) + start + "; " +
         solver_.name();
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
                        Packing* packing) {
  std::string error;
  Packing read;
  if (!ReadPacking(output_->Path("prepared_" + name + ".xyz"), &read, &error)) {
    return false;
  }
  const auto found = read.attributes.find("prepared");
  if (found == read.attributes.end() || found->second != recipe) return false;
  *packing = std::move(read);
  Note(name, *packing, " (used again)");
  return true;
}

void Preparation::Keep(const std::string& name,
                       const std::string& recipe,
                       Packing packing) {
  packing.attributes["prepared"] = recipe;
  std::string error;
  if (!WriteFileAtomically(output_->Path("prepared_" + name + ".xyz"),
                           FormatPacking(packing),
                           &error)) {
    BadInput(error);
  }
  Note(name, packing, "");
}

void Preparation::Note(const std::string& name,
                       const Packing& packing,
                       const char* remark) {
  QuadResidual judge;
  std::string error;
  if (!EvaluateQuad(packing, scene_.energy, nullptr, &judge, &error)) {
    BadInput(error);
  }
  const auto energy = ContactEnergy::Create(packing, scene_.energy, &error);
  if (energy == nullptr) BadInput(error);
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  double cost;
  Scales scales;
  energy->EvaluateWithScales(zero.data(), &cost, nullptr, &scales);
  const double vanishing = cost > 0.0 ? scales.vanishing : 0.0;
  const auto found = packing.attributes.find("phi_j");
  const double phi = packing.PackingFraction();
  std::string line = name + Format(": phi = %.10g, ", phi);
  if (vanishing > FLAGS_zero_pressure) {
    line += Format(
        "E = %.3e, residual %.0e mean forces", judge.energy, judge.Relative());
  } else {
    line += Format("unjammed, E = %.3g", judge.energy);
  }
  json_.push_back({{"name", name},
                   {"phi", phi},
                   {"energy", judge.energy},
                   {"quad_relative_residual", judge.Relative()}});
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

Packing Preparation::Minimized(const Packing& start,
                               double tolerance,
                               bool* jammed) {
  Relaxation result;
  std::string error;
  if (!Relax(
          start, scene_.energy, solver_, Options(tolerance), &result, &error)) {
    BadInput(scene_.origin + ": " + error);
  }
  if (jammed != nullptr) {
    *jammed = result.summary.reason != StopReason::VANISHED;
  }
  return Annotated(result, scene_.energy);
}

bool Preparation::FindPhiJ(std::uint64_t seed,
                           double error_bar,
                           JammingResult* result,
                           std::string* error) {
  constexpr double kCompression = 5e-3;
  constexpr int kMaxCompressions = 100;
  Packing start = Relaxed(seed);
  stage_ = "a jammed state";
  bool jammed = false;
  start = Minimized(start, 1e-8, &jammed);
  for (int step = 0; !jammed && step < kMaxCompressions; ++step) {
    start.SetPackingFraction(start.PackingFraction() + kCompression);
    start = Minimized(start, 1e-8, &jammed);
  }
  JammingOptions options;
  options.energy = scene_.energy;
  options.solve = Options(1e-8);
  options.solve.vanishing_tolerance = 1e-3 * options.accuracy;
  options.error_bar = std::min(error_bar, options.accuracy);
  const auto observer = [this](const JammingStep& step) {
    stage_ = Format("phi_J, %s, phi = %.10f, p = %.1e",
                    JammingStageName(step.stage),
                    step.phi,
                    step.result->observables.pressure);
    return true;
  };
  std::string why;
  bool found =
      DecompressToJamming(start, options, solver_, observer, result, &why);
  if (found && !result->converged) {
    found = false;
    why = Format(
        "phi_J is known to %.1e only, above %.1e", result->distance, error_bar);
  }
  if (!found) {
    *error = (FLAGS_input.empty()
                  ? Format("seed %llu", static_cast<unsigned long long>(seed))
                  : FLAGS_input) +
             ": " + why;
  }
  return found;
}

}  // namespace granopt
