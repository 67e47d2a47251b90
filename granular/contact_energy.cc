#include "granular/contact_energy.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "granular/network_preconditioner.h"
#include "granular/pair_blocks.h"
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

// Recentre when a grain has moved by more than this many mean overlaps from the
// reference. Near jamming the error of a gap is then still below 1e-14 mean
// overlaps; where overlaps are comparable with radii it reaches 2e-13.
constexpr double kRecenterOverlaps = 10.0;

// In single precision this leaves an error of some eps32 mean overlaps.
constexpr double kRecenterOverlapsSingle = 4.0;

constexpr double kEpsilonSingle = std::numeric_limits<float>::epsilon();
// Mixed precision ends where the gradient is so many of its mean contact force.
constexpr double kRefineBelow = 30.0 * kEpsilonSingle;

// The skin lies between these multiples of the smallest radius and is adapted
// by counts: a list should serve between the two numbers of evaluations.
constexpr double kMinSkin = 0.05;
constexpr double kMaxSkin = 0.8;
constexpr int kFewEvaluations = 20;
constexpr int kManyEvaluations = 200;

// A grain may use this part of half the skin before the list is made again; the
// rest is for the rounding of positions.
constexpr double kUsableSkin = 0.999;

// The Hessian's pattern holds pairs nearer than this part of the smallest
// radius: a wider margin serves longer, but its factor has more entries (0.1
// doubles the time of a factorization).
constexpr double kPatternMargin = 0.02;

// Displacements of more cell heights than this are refused.
constexpr double kMaxCells = 1e6;

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
      u_list_(NumParameters(), 0.0),
      skin_(kMinSkin * min_radius_),
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
  if (packing.size() > std::numeric_limits<int>::max() / 64) {
    *error = std::to_string(packing.size()) + " grains are too many";
    return nullptr;
  }
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
  std::unique_ptr<ContactEnergy> energy(new ContactEnergy(packing, options));
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  if (!energy->BuildList(zero.data(), error)) return nullptr;
  return energy;
}

double ContactEnergy::PairStiffness(int i, int j) const {
  const double ki = packing_.stiffness[i];
  const double kj = packing_.stiffness[j];
  switch (options_.rule) {
    case StiffnessRule::SERIES:
      return options_.stiffness * (2.0 * ki * kj / (ki + kj));
    case StiffnessRule::GEOMETRIC:
      return options_.stiffness * std::sqrt(ki * kj);
    case StiffnessRule::MEAN:
      break;
  }
  return options_.stiffness * (0.5 * (ki + kj));
}

bool ContactEnergy::BuildList(const double* u, std::string* error) const {
  const Eigen::Map<const Eigen::MatrixXd> displacement(
      u, dimension_, num_grains_);
  if (list_version_ > 0) {
    if (evaluations_since_build_ < kFewEvaluations) {
      skin_ = std::min(1.5 * skin_, kMaxSkin * min_radius_);
    } else if (evaluations_since_build_ > kManyEvaluations) {
      skin_ = std::max(skin_ / 1.5, kMinSkin * min_radius_);
    }
  }
  const Eigen::MatrixXd positions = packing_.positions + displacement;
  const auto build = [&]() {
    return BuildNeighborList(
        packing_.box, positions, packing_.radii, skin_, &list_, error);
  };
  // A search takes as much memory as the arrays of the old list, which are
  // needed again only if it is refused.
  pairs_.reference = {};
  pairs_.single = {};
  parts_.clear();
  bool found = build();
  if (!found && skin_ > kMinSkin * min_radius_) {
    // A cell that is too short for a wide skin may do for the narrowest.
    skin_ = kMinSkin * min_radius_;
    found = build();
  }
  if (found) {
    std::copy(u, u + NumParameters(), u_list_.begin());
    UpdateReferenceFromList();
    ++list_version_;
    evaluations_since_build_ = 0;
  }
  // Where the search was refused the list before it stays in use.
  if (list_version_ > 0) SetPairs();
  return found;
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
    for (int i = 0; i < num_grains_; ++i) {
      for (int p = list_.row_start[i]; p < list_.row_start[i + 1]; ++p) {
        pairs_.stiffness[p] = packing_.stiffness.size() > 0
                                  ? PairStiffness(i, list_.j[p])
                                  : options_.stiffness;
      }
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
  if (parts_list_version_ != list_version_ ||
      static_cast<int>(parts_.size()) != count) {
    parts_list_version_ = list_version_;
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
  const double usable = 0.5 * kUsableSkin * skin_;
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
  ++evaluations_since_build_;
  return true;
}

bool ContactEnergy::EvaluateWithScales(const double* u,
                                       double* energy,
                                       double* gradient,
                                       Scales* scales) const {
  if (!Prepare(u)) return false;
  const ContactSums sums = Sweep(gradient);
  *energy = sums.energy;
  if (sums.contacts > 0) {
    last_overlap_ = sums.overlap / static_cast<double>(sums.contacts);
  } else {
    last_overlap_ = 0.0;
  }
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

bool ContactEnergy::HessianTimes(const double* u,
                                 const double* v,
                                 double* hv) const {
  if (!Prepare(u)) return false;
  UpdateStates();
  PairHessianTimes(dimension_, View(), states_, v, hv);
  return true;
}

void ContactEnergy::UpdateStates() const {
  const std::size_t m = list_.num_pairs() + kPairPadding;
  states_memory_.resize((4 + dimension_) * m);
  double* next = states_memory_.data();
  const auto array = [&next, m]() {
    next += m;
    return next - m;
  };
  states_.delta = array();
  states_.distance = array();
  for (int k = 0; k < dimension_; ++k) states_.normal[k] = array();
  states_.force = array();
  states_.stiffness = array();
  loops_.states(View(), options_.alpha, workspace_.data(), states_);
}

void ContactEnergy::UpdatePattern(const double* first) const {
  const int d = dimension_;
  if (pattern_list_version_ == list_version_) {
    int outside = 0;  // counted rather than sought: no branches
    for (int p = 0; p < list_.num_pairs(); ++p) {
      outside += static_cast<int>(block_rank_[p] < 0) &
                 static_cast<int>(first[p] != 0.0);
    }
    if (outside == 0) return;
  }
  pattern_list_version_ = list_version_;
  ++pattern_version_;
  // The columns of grain i hold the lower part of its own block, then one block
  // for each j > i (several images of j share it); the number of entries is
  // known, so the pattern is written in place.
  block_rank_.assign(list_.num_pairs(), -1);
  has_shared_blocks_ = false;
  column_start_.assign(NumParameters() + 1, 0);
  const double margin = kPatternMargin * min_radius_;
  for (int i = 0; i < num_grains_; ++i) {
    int blocks = 0;
    int previous = i;
    for (int p = list_.row_start[i]; p < list_.row_start[i + 1]; ++p) {
      if (list_.j[p] == i) {
        block_rank_[p] = 0;  // never needed: an image moves with its grain
        continue;
      }
      if (!(states_.delta[p] > -margin) && first[p] == 0.0) continue;
      if (list_.j[p] != previous) {
        ++blocks;
      } else {
        has_shared_blocks_ = true;
      }
      previous = list_.j[p];
      block_rank_[p] = blocks - 1;
    }
    for (int c = 0; c < d; ++c) {
      column_start_[d * i + c + 1] =
          column_start_[d * i + c] + (d - c) + d * blocks;
    }
  }
  rows_.resize(column_start_[NumParameters()]);
  for (int i = 0; i < num_grains_; ++i) {
    for (int c = 0; c < d; ++c) {
      int* row = rows_.data() + column_start_[d * i + c];
      for (int r = c; r < d; ++r) *row++ = d * i + r;
      int previous = -1;
      for (int p = list_.row_start[i]; p < list_.row_start[i + 1]; ++p) {
        if (block_rank_[p] == previous || block_rank_[p] < 0 ||
            list_.j[p] == i) {
          continue;
        }
        previous = block_rank_[p];
        for (int r = 0; r < d; ++r) *row++ = d * list_.j[p] + r;
      }
    }
  }
}

void ContactEnergy::WriteBlocks(const double* first,
                                const double* second,
                                double theta,
                                SparseMatrix* hessian) const {
  UpdatePattern(first);
  const int n = NumParameters();
  // A matrix that has this pattern already, as the one before it often has, is
  // compared: to read is less than to write.
  if (!(hessian->rows() == n && hessian->cols() == n &&
        hessian->isCompressed() && hessian->nonZeros() == column_start_[n] &&
        std::equal(column_start_.begin(),
                   column_start_.end(),
                   hessian->outerIndexPtr()) &&
        std::equal(rows_.begin(), rows_.end(), hessian->innerIndexPtr()))) {
    hessian->resize(n, n);
    hessian->resizeNonZeros(column_start_[n]);
    std::copy(
        column_start_.begin(), column_start_.end(), hessian->outerIndexPtr());
    std::copy(rows_.begin(), rows_.end(), hessian->innerIndexPtr());
  }
  loops_.blocks(View(),
                states_,
                first,
                second,
                theta,
                {block_rank_.data(), column_start_.data(), has_shared_blocks_},
                hessian->valuePtr());
}

bool ContactEnergy::EvaluateStiffness(const double* u,
                                      double theta,
                                      SparseMatrix* hessian) const {
  if (!Prepare(u)) return false;
  UpdateStates();
  WriteBlocks(states_.stiffness, states_.force, theta, hessian);
  return true;
}

bool ContactEnergy::EvaluateWeightedHessian(const double* u,
                                            const double* first,
                                            const double* second,
                                            SparseMatrix* hessian) const {
  const std::int64_t version = list_version_;
  if (!Prepare(u) || version != list_version_) return false;
  UpdateStates();
  WriteBlocks(first, second, 1.0, hessian);
  return true;
}

void ContactEnergy::EvaluateLaw(int n,
                                const double* overlap,
                                double* force,
                                double* stiffness) const {
  loops_.law(options_.alpha, n, overlap, force, stiffness);
}

bool ContactEnergy::EvaluateGaps(const double* u, Gaps* gaps) const {
  if (!Prepare(u)) return false;
  UpdateStates();
  const int d = dimension_;
  const int m = list_.num_pairs();
  gaps->ids.resize(m);
  gaps->delta.resize(m);
  gaps->stiffness.resize(m);
  gaps->curvature.resize(m);
  gaps->margin = kPatternMargin * min_radius_;
  auto& jacobian = gaps->jacobian;
  jacobian.resize(m, NumParameters());
  jacobian.resizeNonZeros(static_cast<Eigen::Index>(m) * 2 * d);
  int* row_end = jacobian.outerIndexPtr();
  int* column = jacobian.innerIndexPtr();
  double* value = jacobian.valuePtr();
  *row_end = 0;
  for (int i = 0; i < num_grains_; ++i) {
    for (int p = list_.row_start[i]; p < list_.row_start[i + 1]; ++p) {
      const int j = list_.j[p];
      gaps->ids[p] = {i, j, list_.image[p]};
      gaps->delta[p] = states_.delta[p];
      gaps->stiffness[p] = pairs_.stiffness.empty() ? 1.0 : pairs_.stiffness[p];
      // n (x) n is removed from the unit matrix, and 1 / l is left. Centres
      // that coincide have no direction.
      gaps->curvature[p] =
          i != j && states_.distance[p] > 0.0 ? 1.0 / states_.distance[p] : 0.0;
      *(row_end + 1) = *row_end;
      ++row_end;
      if (i == j) continue;  // an image moves with its grain
      *row_end += 2 * d;
      for (int k = 0; k < d; ++k) {
        *column++ = d * i + k;
        *value++ = -states_.normal[k][p];
      }
      for (int k = 0; k < d; ++k) {
        *column++ = d * j + k;
        *value++ = states_.normal[k][p];
      }
    }
  }
  jacobian.resizeNonZeros(*row_end);
  return true;
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

std::vector<Contact> ContactEnergy::Contacts(const double* u) const {
  std::vector<Contact> contacts;
  if (!Prepare(u)) return contacts;
  UpdateStates();
  contacts.reserve(std::count_if(states_.delta,
                                 states_.delta + list_.num_pairs(),
                                 [](double delta) { return delta > 0.0; }));
  for (int i = 0; i < num_grains_; ++i) {
    for (int p = list_.row_start[i]; p < list_.row_start[i + 1]; ++p) {
      if (!(states_.delta[p] > 0.0)) continue;
      Contact contact;
      contact.id = {i, list_.j[p], list_.image[p]};
      contact.overlap = states_.delta[p];
      contact.distance = states_.distance[p];
      contact.normal.resize(dimension_);
      for (int k = 0; k < dimension_; ++k) {
        contact.normal[k] = states_.normal[k][p];
      }
      contact.force = states_.force[p];
      contact.stiffness = states_.stiffness[p];
      contacts.push_back(contact);
    }
  }
  return contacts;
}

}  // namespace granopt
