#include "granular/contact_kernel.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include "granular/contact_law.h"

namespace granopt {
namespace {

template <int D, typename Law>
class Kernel final : public ContactKernel {
 public:
  explicit Kernel(double alpha) : law_(alpha) {}

  ContactSums Evaluate(const PairView& pairs,
                       const double* w,
                       double* gradient) const override {
    if (pairs.stiffness == nullptr) {
      return gradient == nullptr ? Sweep<false, false>(pairs, w, nullptr)
                                 : Sweep<true, false>(pairs, w, gradient);
    }
    return gradient == nullptr ? Sweep<false, true>(pairs, w, nullptr)
                               : Sweep<true, true>(pairs, w, gradient);
  }

  void States(const PairView& pairs,
              const double* w,
              PairState* states) const override {
    for (int i = 0; i < pairs.num_grains; ++i) {
      for (int p = pairs.row_start[i]; p < pairs.row_start[i + 1]; ++p) {
        states[p] = State(pairs, w, i, p);
      }
    }
  }

  void AddBlocks(const PairView& pairs,
                 const PairState* states,
                 const double* first,
                 const double* second,
                 const int* rank,
                 const int* column_start,
                 double* values) const override {
    for (int i = 0; i < pairs.num_grains; ++i) {
      for (int p = pairs.row_start[i]; p < pairs.row_start[i + 1]; ++p) {
        const int j = pairs.j[p];
        if (j == i) continue;  // an image moves with its grain
        const PairState& state = states[p];
        if (rank[p] < 0 || state.distance == 0.0) continue;
        const double tangential = second[p] / state.distance;
        const double normal = first[p] + tangential;
        for (int c = 0; c < D; ++c) {
          double* diagonal_i = values + column_start[D * i + c];
          double* diagonal_j = values + column_start[D * j + c];
          double* below = diagonal_i + (D - c) + D * rank[p];
          for (int r = 0; r < D; ++r) {
            const double k = normal * state.normal[r] * state.normal[c] -
                             (r == c ? tangential : 0.0);
            if (r >= c) {
              diagonal_i[r - c] += k;
              diagonal_j[r - c] += k;
            }
            below[r] -= k;
          }
        }
      }
    }
  }

  void Apply(int m,
             const double* delta,
             double* force,
             double* stiffness) const override {
    for (int p = 0; p < m; ++p) {
      force[p] = law_.Force(delta[p]);
      stiffness[p] = law_.Stiffness(delta[p]);
    }
  }

  void HessianTimes(const PairView& pairs,
                    const double* w,
                    const double* v,
                    double* hv) const override {
    std::fill(hv, hv + D * pairs.num_grains, 0.0);
    for (int i = 0; i < pairs.num_grains; ++i) {
      for (int p = pairs.row_start[i]; p < pairs.row_start[i + 1]; ++p) {
        const int j = pairs.j[p];
        const PairState state = State(pairs, w, i, p);
        if (!(state.delta > 0.0) || state.distance == 0.0) continue;
        const double tangential = state.force / state.distance;
        double dv[D];
        double along = 0.0;
        for (int c = 0; c < D; ++c) {
          dv[c] = v[D * i + c] - v[D * j + c];
          along += state.normal[c] * dv[c];
        }
        along *= state.stiffness + tangential;
        for (int c = 0; c < D; ++c) {
          const double h = along * state.normal[c] - tangential * dv[c];
          hv[D * i + c] += h;
          hv[D * j + c] -= h;
        }
      }
    }
  }

 private:
  // Blocks of pairs: gathered, evaluated without a branch that depends on the
  // data (the compiler makes square roots and divisions of several pairs at
  // once), added up in order. Then the forces are scattered. An open gap adds
  // exact zeros: results do not depend on which open gaps the list holds.
  template <bool kGradient, bool kStiffness>
  ContactSums Sweep(const PairView& pairs,
                    const double* w,
                    double* gradient) const {
    constexpr int kBlock = 64;
    const int n = pairs.num_grains;
    const int m = pairs.row_start[n];
    double* const pair_force = pairs.pair_force;
    double energy = 0.0, force_sum = 0.0, overlap = 0.0, virial = 0.0;
    std::int64_t contacts = 0;
    double s[D][kBlock] = {}, r[D][kBlock] = {};  // in: r = r0
    double d0[kBlock] = {}, delta0[kBlock] = {}, k[kBlock] = {};
    double delta[kBlock], d[kBlock], force[kBlock], e[kBlock];
    double f_over_d[kBlock];
    for (int first = 0; first < m; first += kBlock) {
      const int count = std::min(kBlock, m - first);
      for (int q = 0; q < count; ++q) {
        const int p = first + q;
        const ReferencePair& ref = pairs.reference[p];
        const double* wi = w + D * pairs.i[p];
        const double* wj = w + D * pairs.j[p];
        for (int c = 0; c < D; ++c) {
          s[c][q] = wi[c] - wj[c];
          r[c][q] = ref.r0[c];
        }
        d0[q] = ref.d0;
        delta0[q] = ref.delta0;
        if (kStiffness) k[q] = pairs.stiffness[p];
      }
      // The whole block, whatever count is: a fixed length has no remainder
      // loop.
      for (int q = 0; q < kBlock; ++q) {
        double change = 0.0, d2 = 0.0;
        for (int c = 0; c < D; ++c) {
          const double r0 = r[c][q];
          r[c][q] = r0 + s[c][q];
          change += s[c][q] * (r0 + r[c][q]);  // 2 r0.s + s.s
          d2 += r[c][q] * r[c][q];
        }
        d[q] = std::sqrt(d2);
        const double gap = delta0[q] - change / (d[q] + d0[q]);
        delta[q] = gap > 0.0 ? gap : 0.0;
        force[q] = law_.Force(delta[q]);
        e[q] = law_.Energy(delta[q]);
        if (kStiffness) {
          force[q] *= k[q];
          e[q] *= k[q];
        }
        // Centres that coincide have no direction and get no force.
        f_over_d[q] =
            force[q] /
            (d[q] > 0.0 ? d[q] : std::numeric_limits<double>::infinity());
      }
      for (int q = 0; q < count; ++q) {
        energy += e[q];
        force_sum += force[q];
        overlap += delta[q];
        virial += force[q] * d[q];
        contacts += delta[q] > 0.0 ? 1 : 0;
        if (kGradient) {
          for (int c = 0; c < D; ++c) {
            pair_force[D * (first + q) + c] = f_over_d[q] * r[c][q];
          }
        }
      }
    }
    const ContactSums sums = {energy, force_sum, overlap, virial, contacts};
    if (!kGradient) return sums;
    std::fill(gradient, gradient + D * n, 0.0);
    for (int i = 0; i < n; ++i) {
      double gi[D];
      for (int c = 0; c < D; ++c) gi[c] = gradient[D * i + c];
      for (int p = pairs.row_start[i]; p < pairs.row_start[i + 1]; ++p) {
        const int j = pairs.j[p];
        if (j == i) continue;  // pulls on itself from both sides
        for (int c = 0; c < D; ++c) {
          const double f = pair_force[D * p + c];
          gi[c] -= f;
          gradient[D * j + c] += f;
        }
      }
      for (int c = 0; c < D; ++c) gradient[D * i + c] = gi[c];
    }
    return sums;
  }

  PairState State(const PairView& pairs, const double* w, int i, int p) const {
    const ReferencePair& ref = pairs.reference[p];
    const int j = pairs.j[p];
    PairState state;
    double r[D];
    double change = 0.0, d2 = 0.0;
    for (int c = 0; c < D; ++c) {
      const double s = w[D * i + c] - w[D * j + c];
      r[c] = ref.r0[c] + s;
      change += s * (ref.r0[c] + r[c]);
      d2 += r[c] * r[c];
    }
    const double d = std::sqrt(d2);
    state.distance = d;
    state.delta = ref.delta0 - change / (d + ref.d0);
    for (int c = 0; c < 3; ++c) {
      state.normal[c] = c < D && d > 0.0 ? r[c < D ? c : 0] / d : 0.0;
    }
    const double k = pairs.stiffness == nullptr ? 1.0 : pairs.stiffness[p];
    const bool touching = state.delta > 0.0;
    state.energy = touching ? k * law_.Energy(state.delta) : 0.0;
    state.force = touching ? k * law_.Force(state.delta) : 0.0;
    state.stiffness = touching ? k * law_.Stiffness(state.delta) : 0.0;
    return state;
  }

  const Law law_;
};

template <int D, std::size_t kIndex = 0>
std::unique_ptr<ContactKernel> Make(double alpha) {
  if constexpr (kIndex == std::tuple_size_v<ContactLaws>) {
    return nullptr;
  } else {
    using Law = std::tuple_element_t<kIndex, ContactLaws>;
    if (Law::Handles(alpha)) return std::make_unique<Kernel<D, Law>>(alpha);
    return Make<D, kIndex + 1>(alpha);
  }
}

}  // namespace

std::unique_ptr<ContactKernel> MakeContactKernel(int dimension, double alpha) {
  if (dimension == 2) return Make<2>(alpha);
  if (dimension == 3) return Make<3>(alpha);
  return nullptr;
}

}  // namespace granopt
