#include "granular/flow/near_field.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "solvers/format.h"
#include "solvers/threads.h"

namespace granopt {
namespace {

RadialValues Evaluate(const RadialLaw&, double, LawList<>) { return {}; }
template <typename Law, typename... Others>
RadialValues Evaluate(const RadialLaw& law,
                      double square,
                      LawList<Law, Others...>) {
  if (!Law::Handles(law)) return Evaluate(law, square, LawList<Others...>());
  const Law form(law);
  return {form.Potential(square),
          form.ForceOverDistance(square),
          form.Stiffness(square)};
}

// Pieces of the work: a function of n alone, so that sums are the same on any
// number of threads.
int NumPieces(int n) { return std::clamp(n / 512, 1, 16); }

// Grains from which on multipoles were measured to be faster.
int TreeFrom(double accuracy) {
  return accuracy >= 1e-2 ? 25000 : accuracy >= 1e-3 ? 40000 : 80000;
}

}  // namespace

RadialValues EvaluateLaw(const RadialLaw& law, double distance) {
  return Evaluate(law, distance * distance, NearFieldLaws());
}

double EquilibriumDistance(const RadialLaw& law) {
  if (law.form == RadialLaw::Form::MORSE) {
    return law.depth > 0.0 ? law.distance : 0.0;
  }
  if (!(law.strength[0] > 0.0 && law.strength[1] > 0.0 &&
        law.exponent[1] > law.exponent[0])) {
    return 0.0;
  }
  return std::pow(law.strength[1] / law.strength[0],
                  1.0 / (law.exponent[1] - law.exponent[0]));
}

std::unique_ptr<NearField> NearField::Create(const NearFieldOptions& options,
                                             int n,
                                             std::vector<double> weights,
                                             double period,
                                             std::string* error) {
  const RadialLaw& law = options.law;
  for (int k = 0; k < 2; ++k) {
    if (!std::isfinite(law.strength[k]) || law.strength[k] < 0.0) {
      *error = Format("near-field strength alpha%d = %g must be >= 0",
                      k + 1,
                      law.strength[k]);
      return nullptr;
    }
    if (!(law.exponent[k] >= 0.0 && law.exponent[k] <= 100.0)) {
      *error = Format("near-field exponent beta%d = %g must be in [0, 100]",
                      k + 1,
                      law.exponent[k]);
      return nullptr;
    }
  }
  if (law.form == RadialLaw::Form::MORSE &&
      !(std::isfinite(law.depth) && law.steepness > 0.0 &&
        std::isfinite(law.steepness) && law.distance > 0.0 &&
        std::isfinite(law.distance))) {
    *error = Format(
        "Morse depth %g, steepness %g, distance %g: must be finite "
        "and the last two positive",
        law.depth,
        law.steepness,
        law.distance);
    return nullptr;
  }
  const int tree_from = options.tree_from < 0 ? TreeFrom(options.tree_accuracy)
                                              : options.tree_from;
  if (tree_from > 0 &&
      !(options.tree_accuracy >= 1e-9 && options.tree_accuracy <= 0.1)) {
    *error = Format("accuracy %g of the near field must be in [1e-9, 0.1]",
                    options.tree_accuracy);
    return nullptr;
  }
  std::unique_ptr<NearField> field(new NearField);
  field->options_ = options;
  field->n_ = n;
  field->stride_ = FlowStride(n);
  field->weights_ = std::move(weights);
  field->period_ = period;
  field->loops_ = FastestNearFieldLoops(law, period > 0.0);
  if (tree_from > 0 && n >= tree_from && period == 0.0) {
    field->tree_ =
        NearFieldTree::Create(law, n, field->weights_, options.tree_accuracy);
    if (field->tree_ != nullptr) return field;
  }
  const int pieces = NumPieces(n);
  // Row i has n - 1 - i pairs; rows of a piece start at a multiple of lanes.
  field->piece_start_ = {0};
  for (int p = 1; p < pieces; ++p) {
    const double left = 1.0 - std::sqrt(1.0 - static_cast<double>(p) / pieces);
    const int row = static_cast<int>(left * n / kFlowLanes + 0.5) * kFlowLanes;
    field->piece_start_.push_back(std::max(row, field->piece_start_.back()));
  }
  field->piece_start_.push_back(n);
  field->buffers_.resize(static_cast<std::size_t>(pieces - 1) * 3 *
                         field->stride_);
  return field;
}

NearFieldView NearField::View(const double* x) const {
  NearFieldView view;
  view.n = n_;
  for (int k = 0; k < 3; ++k) view.x[k] = x + k * stride_;
  view.weight = weights_.data();
  view.period = period_;
  return view;
}

void NearField::Forces(const double* x, double* force, double* energy) const {
  if (tree_ != nullptr) {
    tree_->Forces(x, force, energy, &least_distance_, &error_bound_);
    return;
  }
  const std::size_t size = 3 * static_cast<std::size_t>(stride_);
  const int pieces = static_cast<int>(piece_start_.size()) - 1;
  const NearFieldView view = View(x);
  std::vector<NearFieldSums> sums(pieces);
  ForEach(pieces, [&](int p) {
    double* const to = p == 0 ? force : buffers_.data() + (p - 1) * size;
    std::fill(to, to + size, 0.0);
    double* const parts[3] = {to, to + stride_, to + 2 * stride_};
    sums[p] = loops_.triangle(options_.law,
                              view,
                              piece_start_[p],
                              piece_start_[p + 1],
                              energy != nullptr,
                              parts);
  });
  double total = 0.0;
  double least = std::numeric_limits<double>::infinity();
  for (int p = 0; p < pieces; ++p) {
    total += sums[p].energy;
    least = std::min(least, sums[p].least_square);
    if (p == 0) continue;
    const double* const from = buffers_.data() + (p - 1) * size;
    for (std::size_t k = 0; k < size; ++k) force[k] += from[k];
  }
  if (energy != nullptr) *energy = total;
  least_distance_ = std::sqrt(least);
}

void NearField::ForceOn(int i,
                        const double* x,
                        const double* at,
                        double* force,
                        double* energy) const {
  const NearFieldSums sums =
      loops_.row(options_.law, View(x), i, at, energy != nullptr, force);
  if (energy != nullptr) *energy = sums.energy;
}

}  // namespace granopt
