#include "granular/contact_energy.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "granular/network_preconditioner.h"
#include "solvers/format.h"
#include "solvers/power_of_two.h"
#include "solvers/threads.h"

namespace granopt {
namespace {

// Of k r^alpha, and one over its largest: squares of small parts of it must
// still be numbers.
constexpr double kSmallestUnit = 1e-280;

// Here, since whoever links an energy may name its preconditioners.
[[maybe_unused]] const bool registered =
    (RegisterNetworkPreconditioners(), true);

// In place of kRecenterOverlaps, which leaves an error of some eps32 mean
// overlaps.
constexpr double kRecenterOverlapsSingle = 4.0;

constexpr double kEpsilonSingle = std::numeric_limits<float>::epsilon();
// Mixed precision ends where the gradient is so many of its mean contact force.
constexpr double kRefineBelow = 30.0 * kEpsilonSingle;

}  // namespace

const char* PrecisionName(Precision precision) {
  switch (precision) {
    case Precision::DOUBLE:
      return "double";
    case Precision::MIXED:
      return "mixed";
    case Precision::FLOAT:
      return "float";
  }
  return "unknown";
}

double PairStiffness(const Packing& packing,
                     const ContactEnergyOptions& options,
                     int i,
                     int j) {
  if (packing.stiffness.size() == 0) return options.stiffness;
  const double ki = packing.stiffness[i];
  const double kj = packing.stiffness[j];
  switch (options.rule) {
    case StiffnessRule::SERIES:
      return options.stiffness * (2.0 * ki * kj / (ki + kj));
    case StiffnessRule::GEOMETRIC:
      return options.stiffness * std::sqrt(ki * kj);
    case StiffnessRule::MEAN:
      break;
  }
  return options.stiffness * (0.5 * (ki + kj));
}

ContactEnergy::ContactEnergy(const Packing& packing,
                             const ContactEnergyOptions& options)
    : options_(options),
      dimension_(packing.dimension()),
      num_grains_(packing.size()),
      packing_(packing),
      mean_radius_(packing.MeanRadius()),
      min_radius_(packing.radii.minCoeff()),
      loops_(FastestPairLoops(packing.dimension(), options.alpha)),
      u_reference_(NumParameters(), 0.0),
      workspace_(NumParameters(), 0.0),
      list_(min_radius_),
      u_list_(NumParameters(), 0.0),
      is_single_(options.precision != Precision::DOUBLE),
      single_unit_(PowerOfTwo(mean_radius_)) {}

std::unique_ptr<ContactEnergy> ContactEnergy::Create(
    const Packing& packing,
    const ContactEnergyOptions& options,
    std::string* error) {
  if (!packing.IsValid(error)) return nullptr;
  if (!(options.alpha >= 2.0) || !std::isfinite(options.alpha)) {
    *error = "alpha = " + std::to_string(options.alpha) + " must be >= 2";
    return nullptr;
  }
  if (!(options.stiffness > 0.0) || !std::isfinite(options.stiffness)) {
    *error = "k = " + std::to_string(options.stiffness) + " must be positive";
    return nullptr;
  }
  if (!options.fixed.empty() &&
      static_cast<int>(options.fixed.size()) != packing.size()) {
    *error = "a mask of fixed grains of another length";
    return nullptr;
  }
  if (packing.size() > kMostGrains) {
    *error = std::to_string(packing.size()) + " grains are too many";
    return nullptr;
  }
  std::unique_ptr<ContactEnergy> energy(new ContactEnergy(packing, options));
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  if (!energy->BuildList(zero.data(), error)) return nullptr;
  // Products of energies near the limits of double would be zero or infinite.
  const double radius = packing.MeanRadius();
  for (const double k :
       {packing.stiffness.size() == 0 ? 1.0 : packing.stiffness.minCoeff(),
        packing.stiffness.size() == 0 ? 1.0 : packing.stiffness.maxCoeff()}) {
    const double unit = options.stiffness * k * std::pow(radius, options.alpha);
    if (unit >= kSmallestUnit && unit <= 1.0 / kSmallestUnit) continue;
    *error = Format(
        "energies k r^alpha = %.3g (k = %g, mean radius r = %g, alpha = %g) "
        "must lie in [%g, %g]: choose other units",
        unit,
        options.stiffness * k,
        radius,
        options.alpha,
        kSmallestUnit,
        1.0 / kSmallestUnit);
    return nullptr;
  }
  return energy;
}

bool ContactEnergy::BuildList(const double* u, std::string* error) const {
  const Eigen::Map<const Eigen::MatrixXd> displacement(
      u, dimension_, num_grains_);
  const Eigen::MatrixXd positions = packing_.positions + displacement;
  // A search takes as much memory as the arrays of the old list, which are
  // needed again only if it is refused.
  pairs_.reference = {};
  pairs_.single = {};
  parts_.clear();
  const bool found =
      list_.Renew(packing_.box, positions, packing_.radii, error);
  if (found) {
    RemoveFixedPairs();
    std::copy(u, u + NumParameters(), u_list_.begin());
    UpdateReferenceFromList();
  }
  // Where the search was refused the list before it stays in use.
  if (list_.version() > 0) SetPairs();
  return found;
}

void ContactEnergy::RemoveFixedPairs() const {
  if (options_.fixed.empty()) return;
  int kept = 0;
  for (int i = 0; i < num_grains_; ++i) {
    const int first = list_.row_start[i];
    list_.row_start[i] = kept;
    for (int p = first; p < list_.row_start[i + 1]; ++p) {
      if (options_.fixed[i] && options_.fixed[list_.j[p]]) continue;
      list_.i[kept] = i;
      list_.j[kept] = list_.j[p];
      list_.image[kept] = list_.image[p];
      ++kept;
    }
  }
  list_.row_start[num_grains_] = kept;
  list_.i.resize(kept);
  list_.j.resize(kept);
  list_.image.resize(kept);
}

void ContactEnergy::SetPairs() const {
  const auto set = [this](const std::vector<int>& grains,
                          std::vector<int>* at) {
    at->assign(grains.size() + kPairPadding, 0);
    std::transform(grains.begin(), grains.end(), at->begin(), [this](int i) {
      return dimension_ * i;
    });
  };
  set(list_.i, &pairs_.at_i);
  set(list_.j, &pairs_.at_j);
  has_self_pairs_ = false;
  for (int p = 0; p < list_.num_pairs(); ++p) {
    has_self_pairs_ = has_self_pairs_ || list_.i[p] == list_.j[p];
  }
  pairs_.stiffness.clear();
  if (packing_.stiffness.size() > 0 || options_.stiffness != 1.0) {
    pairs_.stiffness.assign(list_.num_pairs() + kPairPadding, 1.0);
    for (int p = 0; p < list_.num_pairs(); ++p) {
      pairs_.stiffness[p] =
          PairStiffness(packing_, options_, list_.i[p], list_.j[p]);
    }
  }
  RenewReferencePairs();
}

void ContactEnergy::RenewReferencePairs() const {
  pairs_.reference.is_current = false;
  pairs_.single.is_current = false;
  for (Part& part : parts_) {
    part.shared.reference.is_current = false;
    part.shared.single.is_current = false;
  }
  SetReferencePairs(is_single_);
}

void ContactEnergy::SetReferencePairs(bool single) const {
  const int d = dimension_;
  const std::size_t m = list_.num_pairs() + kPairPadding;
  std::vector<DoubleDouble> x(NumParameters());
  ForPieces([&](int /*piece*/, int first, int end) {
    for (int i = first; i < end; ++i) {
      for (int k = 0; k < d; ++k) {
        x[d * i + k] = packing_.Position(i, k) + u_reference_[d * i + k];
      }
    }
  });
  const auto set = [&](auto* pairs, const auto& rounded, int exponent) {
    for (int k = 0; k < d; ++k) pairs->r0[k].assign(m, 1);
    pairs->d0.assign(m, 1);
    pairs->delta0.assign(m, -1);
    pairs->is_current = true;
    // A positive d0 keeps the kernel's quotients in range where centres
    // coincide; so many powers of two below the radii it is not seen otherwise.
    const double least_distance =
        std::ldexp(1.0, std::ilogb(min_radius_) + exponent);
    ForPieces([&](int /*piece*/, int first, int end) {
      for (int i = first; i < end; ++i) {
        for (int p = list_.row_start[i]; p < list_.row_start[i + 1]; ++p) {
          const int j = list_.j[p];
          DoubleDouble square;
          for (int k = 0; k < d; ++k) {
            DoubleDouble r = x[d * i + k] - x[d * j + k];
            for (int c = 0; c < d; ++c) {
              const int n = list_.image[p][c];
              if (n != 0) r = r + TwoProduct(n, packing_.box.edges()(k, c));
            }
            pairs->r0[k][p] = rounded(r.hi);
            square = square + r * r;
          }
          const DoubleDouble distance = Sqrt(square);
          pairs->d0[p] = rounded(std::max(distance.hi, least_distance));
          pairs->delta0[p] =
              rounded((TwoSum(packing_.radii[i], packing_.radii[j]) - distance)
                          .Value());
        }
      }
    });
  };
  if (single) {
    single_workspace_.resize(NumParameters());
    set(
        &pairs_.single,
        [unit = single_unit_](double v) {
          return static_cast<float>(v / unit);
        },
        -40);
  } else {
    set(
        &pairs_.reference, [](double v) { return v; }, -300);
  }
}

PairView ContactEnergy::View() const {
  if (!pairs_.reference.is_current) SetReferencePairs(/*single=*/false);
  PairView view = View(pairs_, 0, list_.num_pairs());
  view.end_grain = num_grains_;
  view.is_guarded = has_self_pairs_;
  return view;
}

PairView ContactEnergy::View(const PairArrays& pairs,
                             int first,
                             int end) const {
  PairView view;
  view.num_pairs = end - first;
  view.at_i = pairs.at_i.data() + first;
  view.at_j = pairs.at_j.data() + first;
  const auto set = [&](const auto& from, auto* to) {
    if (!from.is_current) return;
    for (int k = 0; k < dimension_; ++k) to->r0[k] = from.r0[k].data() + first;
    to->d0 = from.d0.data() + first;
    to->delta0 = from.delta0.data() + first;
  };
  set(pairs.reference, &view);
  set(pairs.single, &view.single);
  view.single.unit = single_unit_;
  view.single.w = single_workspace_.data();
  view.stiffness =
      pairs.stiffness.empty() ? nullptr : pairs.stiffness.data() + first;
  return view;
}

int ContactEnergy::NumPieces() const {
  return (num_grains_ + kPieceGrains - 1) / kPieceGrains;
}

template <typename Function>
void ContactEnergy::ForPieces(const Function& f) const {
  if (num_grains_ <= kPieceGrains) return f(0, 0, num_grains_);
  ForEach(NumPieces(), [&](int k) {
    f(k, k * kPieceGrains, std::min((k + 1) * kPieceGrains, num_grains_));
  });
}

Displacement ContactEnergy::Displace(const double* u,
                                     const double* u_list) const {
  if (NumPieces() == 1) {
    return loops_.displace(
        NumParameters(), u, u_reference_.data(), u_list, workspace_.data());
  }
  std::vector<Displacement> all(NumPieces());
  ForPieces([&](int piece, int first, int end) {
    const int v = dimension_ * first;
    all[piece] = loops_.displace(dimension_ * (end - first),
                                 u + v,
                                 u_reference_.data() + v,
                                 u_list + v,
                                 workspace_.data() + v);
  });
  Displacement most = all[0];
  for (const Displacement& one : all) {
    most.is_finite = most.is_finite && one.is_finite;
    most.from_reference = std::max(most.from_reference, one.from_reference);
    most.from_list = std::max(most.from_list, one.from_list);
  }
  return most;
}

void ContactEnergy::SetParts() const {
  const int pieces = NumPieces();
  const int count = std::min(NumThreads(), pieces);
  if (parts_list_version_ != list_.version() ||
      static_cast<int>(parts_.size()) != count) {
    parts_list_version_ = list_.version();
    parts_.assign(count, Part());
    // As many pairs each as pieces allow, and at least one piece.
    const auto row = [&](int piece) {
      return list_.row_start[std::min(piece * kPieceGrains, num_grains_)];
    };
    int piece = 0;
    for (int t = 0; t < count; ++t) {
      parts_[t].first_piece = piece++;
      const double until =
          static_cast<double>(list_.num_pairs()) * (t + 1) / count;
      while (piece < pieces - (count - 1 - t) &&
             0.5 * (row(piece) + row(piece + 1)) < until) {
        ++piece;
      }
      if (t == count - 1) piece = pieces;
      parts_[t].end_piece = piece;
    }
    ForEach(count - 1, [&](int before) {
      Part& part = parts_[before + 1];
      const int first = part.first_piece * kPieceGrains;
      const int end = part.end_piece * kPieceGrains;
      for (int p = 0; p < row(part.first_piece); ++p) {
        if (list_.j[p] >= first && list_.j[p] < end) {
          part.shared_rank.push_back(p);
        }
      }
    });
  }
  const auto copy = [](const auto& from,
                       const std::vector<int>& rank,
                       auto* to) {
    to->resize(rank.size() + kPairPadding);
    for (std::size_t s = 0; s < rank.size(); ++s) (*to)[s] = from[rank[s]];
    // Padding is what the list has.
    std::copy(from.end() - kPairPadding, from.end(), to->end() - kPairPadding);
  };
  ForEach(count, [&](int t) {
    Part& part = parts_[t];
    const auto refer = [&](const auto& from, auto* to) {
      if (to->is_current) return;
      for (int k = 0; k < dimension_; ++k) {
        copy(from.r0[k], part.shared_rank, &to->r0[k]);
      }
      copy(from.d0, part.shared_rank, &to->d0);
      copy(from.delta0, part.shared_rank, &to->delta0);
      to->is_current = true;
    };
    if (part.shared_rank.empty()) return;
    if (part.shared.at_i.empty()) {
      copy(pairs_.at_i, part.shared_rank, &part.shared.at_i);
      copy(pairs_.at_j, part.shared_rank, &part.shared.at_j);
      if (!pairs_.stiffness.empty()) {
        copy(pairs_.stiffness, part.shared_rank, &part.shared.stiffness);
      }
    }
    if (is_single_) {
      refer(pairs_.single, &part.shared.single);
    } else {
      refer(pairs_.reference, &part.shared.reference);
    }
  });
}

ContactSums ContactEnergy::Sweep(double* gradient) const {
  const PairSweep sweep = is_single_ ? loops_.single_sweep : loops_.sweep;
  const double* const w = workspace_.data();
  if (!(is_single_ ? pairs_.single.is_current : pairs_.reference.is_current)) {
    SetReferencePairs(is_single_);
  }
  SetParts();
  if (is_single_) {
    ForPieces([&](int /*piece*/, int first, int end) {
      const int v = dimension_ * first;
      loops_.narrow(dimension_ * (end - first),
                    1.0 / single_unit_,
                    w + v,
                    single_workspace_.data() + v);
    });
  }
  std::vector<ContactSums> sums(NumPieces());
  ForEach(static_cast<int>(parts_.size()), [&](int t) {
    const Part& part = parts_[t];
    const int first_grain = part.first_piece * kPieceGrains;
    const int end_grain = std::min(part.end_piece * kPieceGrains, num_grains_);
    const auto its_own = [&](PairView view) {
      view.first_grain = first_grain;
      view.end_grain = end_grain;
      view.is_guarded = has_self_pairs_ || parts_.size() > 1;
      return view;
    };
    if (gradient != nullptr) {
      std::fill(gradient + dimension_ * first_grain,
                gradient + dimension_ * end_grain,
                0.0);
      const int shared = static_cast<int>(part.shared_rank.size());
      if (shared > 0) {
        sweep(
            its_own(View(part.shared, 0, shared)), options_.alpha, w, gradient);
      }
    }
    for (int k = part.first_piece; k < part.end_piece; ++k) {
      const int first = k * kPieceGrains;
      const int end = std::min(first + kPieceGrains, num_grains_);
      sums[k] = sweep(
          its_own(View(pairs_, list_.row_start[first], list_.row_start[end])),
          options_.alpha,
          w,
          gradient);
    }
  });
  ContactSums total = sums[0];
  for (std::size_t k = 1; k < sums.size(); ++k) {
    total.energy += sums[k].energy;
    total.force += sums[k].force;
    total.overlap += sums[k].overlap;
    total.virial += sums[k].virial;
    total.contacts += sums[k].contacts;
  }
  return total;
}

void ContactEnergy::UpdateReferenceFromList() const {
  reference_from_list_ = 0.0;
  for (int v = 0; v < NumParameters(); ++v) {
    reference_from_list_ =
        std::max(reference_from_list_, std::abs(u_reference_[v] - u_list_[v]));
  }
}

bool ContactEnergy::HasLeftSkin(const double* u, double usable) const {
  for (int i = 0; i < num_grains_; ++i) {
    double moved2 = 0.0;
    for (int v = dimension_ * i; v < dimension_ * (i + 1); ++v) {
      moved2 += (u[v] - u_list_[v]) * (u[v] - u_list_[v]);
    }
    if (moved2 > usable * usable) return true;
  }
  return false;
}

bool ContactEnergy::Prepare(const double* u) const {
  const int d = dimension_;
  const int n = NumParameters();
  const double usable = 0.5 * list_.usable_skin();
  // No grain has moved by more than sqrt(d) times its largest coordinate, and
  // none is farther from the list than from the reference and that from the
  // list: as long as this is enough, u_list_ stays in memory.
  const auto is_within = [d, usable](double most) {
    return d * most * most <= usable * usable;
  };
  const auto is_bounded = [&]() {
    return is_within(moved_.from_reference + reference_from_list_);
  };
  bool stays = false;
  if (is_bounded()) {
    moved_ = Displace(u, u_reference_.data());
    stays = is_bounded();
  }
  if (!stays) {
    moved_ = Displace(u, u_list_.data());
    stays = is_within(moved_.from_list);
  }
  if (!moved_.is_finite) return false;
  if (!stays && HasLeftSkin(u, usable)) {
    double max_u = 0.0;
    for (int v = 0; v < n; ++v) max_u = std::max(max_u, std::abs(u[v]));
    double least_height = packing_.box.Height(0);
    for (int k = 1; k < d; ++k) {
      least_height = std::min(least_height, packing_.box.Height(k));
    }
    if (max_u > kMaxCells * least_height) return false;
    std::string error;
    if (!BuildList(u, &error)) return false;
  }
  list_.CountEvaluation();
  return true;
}

bool ContactEnergy::EvaluateWithScales(const double* u,
                                       double* energy,
                                       double* gradient,
                                       Scales* scales) const {
  if (!Prepare(u)) return false;
  const ContactSums sums = Sweep(gradient);
  if (gradient != nullptr && !options_.fixed.empty()) {
    for (int i = 0; i < num_grains_; ++i) {
      if (IsFixed(i)) std::fill_n(gradient + dimension_ * i, dimension_, 0.0);
    }
  }
  *energy = sums.energy;
  last_overlap_ = sums.contacts > 0
                      ? sums.overlap / static_cast<double>(sums.contacts)
                      : 0.0;
  if (scales != nullptr) {
    *scales = Scales();
    if (is_single_) scales->epsilon = kEpsilonSingle;
    if (is_single_ && options_.precision == Precision::MIXED) {
      scales->refine_below = kRefineBelow;
    }
    scales->length = last_overlap_ / (options_.alpha - 1.0);
    scales->gradient = sums.contacts > 0
                           ? sums.force / static_cast<double>(sums.contacts)
                           : 0.0;
    const double pressure = sums.virial / (dimension_ * packing_.box.Volume());
    const double unit = options_.stiffness *
                        std::pow(mean_radius_, options_.alpha - dimension_);
    // The pressure alone would call a few deep overlaps in a wide cell nothing.
    scales->vanishing =
        std::max(std::pow(pressure / unit, 1.0 / (options_.alpha - 1.0)),
                 last_overlap_ / mean_radius_);
  }
  return true;
}

bool ContactEnergy::Recenter(const double* u) {
  // A first look without a pass over u: how far the last point that was
  // evaluated had moved, which is u or near it.
  const double most = is_single_ ? kRecenterOverlapsSingle : kRecenterOverlaps;
  const auto is_far = [this, most](double moved) {
    return last_overlap_ != 0.0 && moved > most * last_overlap_;
  };
  if (!is_far(moved_.from_reference)) return false;
  const Displacement moved = Displace(u, u);
  if (!moved.is_finite || !is_far(moved.from_reference)) return false;
  std::copy(u, u + NumParameters(), u_reference_.begin());
  UpdateReferenceFromList();
  RenewReferencePairs();
  return true;
}

bool ContactEnergy::Rebase(double* u) {
  // Prepare() makes sure that u is served before anything is moved.
  if (!Prepare(u)) return false;
  // Not wrapped: images, the names of gaps, stay as they are, and so does the
  // list.
  packing_ = Configuration(u);
  for (int v = 0; v < NumParameters(); ++v) {
    u_list_[v] -= u[v];
    u_reference_[v] = 0.0;
    u[v] = 0.0;
  }
  UpdateReferenceFromList();
  RenewReferencePairs();
  return true;
}

bool ContactEnergy::Refine() {
  return options_.precision == Precision::MIXED && UseDouble();
}

bool ContactEnergy::UseDouble() {
  const bool was_single = is_single_;
  is_single_ = false;
  pairs_.single = {};
  for (Part& part : parts_) part.shared.single = {};
  single_workspace_ = {};
  return was_single;
}

Packing ContactEnergy::Configuration(const double* u) const {
  Packing result = packing_;
  for (int i = 0; i < num_grains_; ++i) {
    for (int k = 0; k < dimension_; ++k) {
      result.SetPosition(i, k, packing_.Position(i, k) + u[dimension_ * i + k]);
    }
  }
  return result;
}

}  // namespace granopt
