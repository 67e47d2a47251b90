#include "experiments/scaling_laws.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "experiments/statistics.h"
#include "experiments/tabular.h"
#include "granular/distributions.h"
#include "solvers/format.h"
#include "solvers/random.h"

namespace granopt {

static void Columns(ScalingState* state, CsvColumns* columns) {
  columns->Add("particles", &state->particles);
  columns->Add("seed", &state->seed);
  columns->Add("alpha", &state->alpha);
  columns->Add("dimension", &state->dimension);
  columns->Add("asked", &state->asked);
  columns->Add("phi_j", &state->phi_j);
  columns->Add("distance", &state->distance);
  columns->Add("pressure", &state->pressure);
  columns->Add("reduced", &state->reduced);
  columns->Add("bulk", &state->bulk);
  columns->Add("bulk_box", &state->bulk_box);
  columns->Add("bulk_affine", &state->bulk_affine);
  columns->Add("shear", &state->shear);
  columns->Add("shear_mean", &state->shear_mean);
  columns->Add("shear_least", &state->shear_least);
  columns->Add("shear_affine", &state->shear_affine);
  columns->Add("coordination", &state->coordination);
  columns->Add("excess", &state->excess);
  columns->Add("excess_contacts", &state->excess_contacts);
  columns->Add("rigid_grains", &state->rigid_grains);
  columns->Add("rattlers", &state->rattlers);
  columns->Add("fabric_isotropic", &state->fabric_isotropic);
  columns->Add("fabric_deviatoric", &state->fabric_deviatoric);
  columns->Add("stress_deviatoric", &state->stress_deviatoric);
  columns->Add("mean_force", &state->mean_force);
  columns->Add("mean_overlap", &state->mean_overlap);
  columns->Add("stiffness", &state->stiffness);
  columns->Add("residual", &state->residual);
}

namespace {

struct Quantity {
  const char* name;
  double ScalingState::*member;
  // The exponent is alpha - less, or 1 / 2 (less < 0).
  double less;
  bool from_paper;
};

const Quantity kQuantities[] = {
    {"pressure", &ScalingState::pressure, 1.0, true},
    {"bulk", &ScalingState::bulk, 2.0, false},
    {"shear", &ScalingState::shear, 1.5, true},
    {"shear_mean", &ScalingState::shear_mean, 1.5, true},
    {"excess", &ScalingState::excess, -1.0, true},
};

// log y = intercept + slope log x of medians over `packings`; false with fewer
// than two distances left. y[s][k]: of packing s at distance k.
bool FitMedians(const std::vector<std::vector<double>>& x,
                const std::vector<std::vector<double>>& y,
                const std::vector<std::size_t>& packings,
                const std::vector<bool>& used,
                LineFit* line,
                int* left_out) {
  std::vector<double> log_x, log_y, of_x, of_y;
  *left_out = 0;
  for (std::size_t k = 0; k < used.size(); ++k) {
    if (!used[k]) continue;
    of_x.clear();
    of_y.clear();
    for (const std::size_t s : packings) {
      of_x.push_back(x[s][k]);
      of_y.push_back(y[s][k]);
    }
    const double median_x = MedianOf(of_x);
    const double median_y = MedianOf(of_y);
    if (!(median_x > 0.0 && median_y > 0.0)) {
      ++*left_out;
      continue;
    }
    log_x.push_back(std::log(median_x));
    log_y.push_back(std::log(median_y));
  }
  *line = FitLine(log_x, log_y, std::vector<double>(log_x.size(), 1.0));
  return line->n >= 2;
}

}  // namespace

std::string StatesCsv(const std::vector<ScalingState>& states) {
  return FormatCsv(states);
}

bool ReadStates(const std::string& text,
                const std::string& name,
                std::vector<ScalingState>* states,
                std::string* error) {
  std::vector<ScalingState> read;
  if (!ParseCsv(text, name, &read, error)) return false;
  states->insert(states->end(), read.begin(), read.end());
  return true;
}

const std::vector<std::string>& ScalingQuantities() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const Quantity& quantity : kQuantities) all.push_back(quantity.name);
    return all;
  }();
  return names;
}

Exponent FitExponent(const std::vector<ScalingState>& states,
                     const std::string& quantity,
                     double alpha,
                     int particles,
                     const ExponentOptions& options) {
  Exponent fit;
  fit.quantity = quantity;
  fit.alpha = alpha;
  fit.particles = particles;
  const Quantity* what = std::find_if(
      std::begin(kQuantities), std::end(kQuantities), [&](const Quantity& q) {
        return quantity == q.name;
      });
  if (what == std::end(kQuantities)) return fit;
  fit.paper = what->less < 0.0 ? 0.5 : alpha - what->less;
  fit.from_paper = what->from_paper;

  // Packings that have every distance, so that all medians are over the same.
  std::set<double> asked;
  std::map<double, std::map<double, const ScalingState*>> by_seed;
  for (const ScalingState& state : states) {
    if (state.alpha != alpha || state.particles != particles) continue;
    asked.insert(state.asked);
    by_seed[state.seed][state.asked] = &state;
  }
  const std::vector<double> distances(asked.begin(), asked.end());
  std::vector<std::vector<double>> x, y, reduced;
  for (const auto& [seed, of_seed] : by_seed) {
    if (of_seed.size() != distances.size()) continue;
    x.emplace_back();
    y.emplace_back();
    reduced.emplace_back();
    for (const auto& [distance, state] : of_seed) {
      x.back().push_back(state->distance);
      y.back().push_back(state->*what->member);
      reduced.back().push_back(state->reduced);
    }
  }
  fit.packings = static_cast<int>(x.size());
  if (x.empty()) return fit;

  std::vector<bool> used(distances.size(), false);
  const double size = static_cast<double>(particles) * particles;
  for (std::size_t k = 0; k < distances.size(); ++k) {
    std::vector<double> of_k;
    for (const auto& row : reduced) of_k.push_back(row[k]);
    used[k] = MedianOf(of_k) * size >= options.least_size &&
              distances[k] <= options.most_distance * (1.0 + 1e-9);
    if (!used[k]) continue;
    if (fit.distances++ == 0) fit.from = distances[k];
    fit.to = distances[k];
    for (const auto& row : y) fit.negative += row[k] > 0.0 ? 0 : 1;
  }
  std::vector<std::size_t> all(x.size());
  for (std::size_t s = 0; s < all.size(); ++s) all[s] = s;
  LineFit line;
  if (!FitMedians(x, y, all, used, &line, &fit.left_out)) {
    fit.distances = 0;
    return fit;
  }
  fit.distances -= fit.left_out;
  fit.value = line.b;
  fit.prefactor = std::exp(line.a);
  if (x.size() < 3) return fit;

  UniformRandom random(1);
  std::vector<double> values;
  for (int tried = 0; static_cast<int>(values.size()) < options.resamples &&
                      tried < 10 * options.resamples;
       ++tried) {
    std::vector<std::size_t> chosen(x.size());
    for (std::size_t& s : chosen) {
      s = static_cast<std::size_t>(random() * static_cast<double>(x.size()));
    }
    int left_out = 0;
    if (FitMedians(x, y, chosen, used, &line, &left_out)) {
      values.push_back(line.b);
    }
  }
  if (static_cast<int>(values.size()) < options.resamples) return fit;
  fit.low = QuantileOf(values, 0.025);
  fit.high = QuantileOf(values, 0.975);
  return fit;
}

std::string ExponentsCsv(const std::vector<Exponent>& exponents) {
  std::string csv =
      "quantity,alpha,particles,exponent,low,high,prefactor,from,to,distances,"
      "packings,not_positive,left_out,claim,claimed_by\n";
  for (const Exponent& e : exponents) {
    csv += Format(
        "%s,%.17g,%d,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%d,%d,%d,%d,"
        "%.17g,%s\n",
        e.quantity.c_str(),
        e.alpha,
        e.particles,
        e.value,
        e.low,
        e.high,
        e.prefactor,
        e.from,
        e.to,
        e.distances,
        e.packings,
        e.negative,
        e.left_out,
        e.paper,
        e.from_paper ? "paper" : "theory");
  }
  return csv;
}

}  // namespace granopt
