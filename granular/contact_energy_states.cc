// What ContactEnergy makes of the states of its pairs: Hessians, gaps and
// contacts.

#include <algorithm>
#include <utility>

#include "granular/contact_energy.h"

namespace granopt {
namespace {

// hv = H v of the states of all pairs.
template <int D>
void Times(const PairView& pairs,
           const PairStates& states,
           const double* v,
           double* hv) {
  std::fill(hv, hv + D * pairs.end_grain, 0.0);
  for (int p = 0; p < pairs.num_pairs; ++p) {
    if (!(states.delta[p] > 0.0) || states.distance[p] == 0.0) continue;
    const int at_i = pairs.at_i[p], at_j = pairs.at_j[p];
    const double tangential = states.force[p] / states.distance[p];
    double dv[D];
    double along = 0.0;
    for (int c = 0; c < D; ++c) {
      dv[c] = v[at_i + c] - v[at_j + c];
      along += states.normal[c][p] * dv[c];
    }
    along *= states.stiffness[p] + tangential;
    for (int c = 0; c < D; ++c) {
      const double h = along * states.normal[c][p] - tangential * dv[c];
      hv[at_i + c] += h;
      hv[at_j + c] -= h;
    }
  }
}

}  // namespace

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
  if (pattern_list_version_ == list_.version()) {
    int outside = 0;  // counted rather than sought: no branches
    for (int p = 0; p < list_.num_pairs(); ++p) {
      outside += static_cast<int>(block_rank_[p] < 0) &
                 static_cast<int>(first[p] != 0.0);
    }
    if (outside == 0) return;
  }
  pattern_list_version_ = list_.version();
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

double ContactEnergy::StiffnessOfFixed(const double* first) const {
  double most = 0.0;
  for (int p = 0; p < list_.num_pairs(); ++p) most = std::max(most, first[p]);
  return most > 0.0 ? most : 1.0;
}

void ContactEnergy::FixHessian(const double* first,
                               SparseMatrix* hessian) const {
  if (options_.fixed.empty()) return;
  const double stiffness = StiffnessOfFixed(first);
  for (int column = 0; column < NumParameters(); ++column) {
    const bool is_fixed = IsFixed(column / dimension_);
    for (int e = column_start_[column]; e < column_start_[column + 1]; ++e) {
      if (is_fixed || IsFixed(rows_[e] / dimension_)) {
        hessian->valuePtr()[e] = rows_[e] == column ? stiffness : 0.0;
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
  FixHessian(first, hessian);
}

bool ContactEnergy::HessianTimes(const double* u,
                                 const double* v,
                                 double* hv) const {
  if (!Prepare(u)) return false;
  UpdateStates();
  const auto times = dimension_ == 2 ? Times<2> : Times<3>;
  if (options_.fixed.empty()) {
    times(View(), states_, v, hv);
    return true;
  }
  std::vector<double> moved(v, v + NumParameters());
  for (int w = 0; w < NumParameters(); ++w) {
    if (IsFixed(w / dimension_)) moved[w] = 0.0;
  }
  times(View(), states_, moved.data(), hv);
  const double stiffness = StiffnessOfFixed(states_.stiffness);
  for (int w = 0; w < NumParameters(); ++w) {
    if (IsFixed(w / dimension_)) hv[w] = stiffness * v[w];
  }
  return true;
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
  const std::int64_t version = list_.version();
  if (!Prepare(u) || version != list_.version()) return false;
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
      for (const auto& [grain, sign] :
           {std::make_pair(i, -1.0), std::make_pair(j, 1.0)}) {
        if (IsFixed(grain)) continue;
        *row_end += d;
        for (int k = 0; k < d; ++k) {
          *column++ = d * grain + k;
          *value++ = sign * states_.normal[k][p];
        }
      }
    }
  }
  jacobian.resizeNonZeros(*row_end);
  return true;
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
